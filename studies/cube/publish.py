"""Finished runs of a study as one file, small enough to be committed.

    python -m studies.cube.publish FOLDER... --out FILE.tar.xz

A ``FOLDER`` is that of a run, or one above those of runs. A report is made from the archive again
after ``python -m tarfile -e FILE.tar.xz FOLDER``.
"""

import tarfile
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path, PurePosixPath

from src.atomic import replacing
from src.errors import UserError
from src.report.run_group import APART
from src.results.counts import Counts
from src.results.runs import ScoredRun, read_run, run_folders
from src.run_folder import CODE, CONFIG, METRICS, RESULTS, TALLIES
from src.terminal import tracked
from studies.settings import run

FILES = (CONFIG, CODE, METRICS, RESULTS, "class_weights.json")


def main(first: Path, *others: Path, out: Path) -> None:
    paths = run_folders([first, *others], out)
    runs = [read_run(path) for path in tracked(paths, "reading")]
    finished = [each for each in runs if isinstance(each, ScoredRun)]
    if not finished:
        raise UserError(f"{first}: holds no finished run; name a folder of runs")
    publish_runs(finished, out)


def publish_runs(runs: Sequence[ScoredRun], path: Path) -> None:
    """Writes ``<experiment>/seed<k>`` of every run into an archive.

    Of a run: its configuration, code digest, curves, class weights, results and counts by clip,
    without the metrics that no report reads (`APART`); with it what further tasks have scored in
    folders of their own, such as ``attitude/attitude.csv`` and ``attitude/tallies``. The anchors
    are the same beside every run, so they are written once. Raises `UserError` for a file that
    cannot be written.
    """
    with replacing(path) as temporary, tarfile.open(temporary, "w:xz", preset=9) as archive:
        for run in runs:
            folder = PurePosixPath(run.experiment) / f"seed{run.seed}"
            anchors = run.anchors.values() if run is runs[0] else ()
            counts = {f"{TALLIES}/{each.name}.npz": each for each in (run.counts, *anchors)}
            for file in sorted(run.path.glob(f"*/{TALLIES}/*.npz")):
                counts[file.relative_to(run.path).as_posix()] = Counts.read(file)

            further = sorted(path.parent.name for path in run.path.glob(f"*/{TALLIES}"))
            for name in (*FILES, *(f"{each}/{each}.csv" for each in further)):
                if (run.path / name).is_file():
                    _add(archive, folder / name, (run.path / name).read_bytes())
            for name, each in counts.items():
                _add(archive, folder / name, _packed(each))


def _packed(counts: Counts) -> bytes:
    """The file of some counts, uncompressed: the archive packs it tighter than numpy."""
    tables = {name: table for name, table in counts.tables.items() if name not in APART}
    with tempfile.TemporaryDirectory() as folder:
        replace(counts, tables=tables).write(file := Path(folder) / "counts.npz", compressed=False)
        return file.read_bytes()


def _add(archive: tarfile.TarFile, name: PurePosixPath, content: bytes) -> None:
    # Without a date or an owner: the same runs give the same bytes.
    member = tarfile.TarInfo(str(name))
    member.size = len(content)
    archive.addfile(member, BytesIO(content))


if __name__ == "__main__":
    run(main)
