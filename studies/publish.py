"""A study as one compressed file, small enough to be published: runs of a report, or flights."""

import lzma
import tempfile
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath

from ..atomic import replacing
from ..data.files import BROKEN
from ..errors import UserError
from ..run_folder import CODE, CONFIG, METRICS, RESULTS, TALLIES
from .counts import Counts
from .flights import FLIGHTS
from .foretelling import MAPS, Perception, counts_by_map
from .runs import ScoredRun
from .windows import WINDOWS, Windows, packed_windows

FILES = (CONFIG, CODE, METRICS, RESULTS, "class_weights.json")
ENDING = ".zip"

# Gives a text in which unpacked files have the name of their archive.
Naming = Callable[[str], str]

# Bytes that an archive may hold when it is unpacked: far more than any study has.
LARGEST = 4_000_000_000

# What zipfile raises over a file that is no archive, is cut off, encrypted or damaged.
NO_ARCHIVE = (*BROKEN, NotImplementedError, lzma.LZMAError)


def publish_runs(
    groups: Sequence[Sequence[ScoredRun]], path: Path, without: Collection[str]
) -> None:
    """Writes ``<experiment>/seed<k>`` of every run into an archive: its configuration, code digest,
    curves, class weights and results, and its counts by clip but those of the metrics ``without``;
    with it what further tasks have scored in folders of their own, as ``attitude/attitude.csv`` and
    ``attitude/tallies``.

    The anchors are the same beside every run of a group, so they are written once. Further groups
    of a mixed report have folders of their own, ``group2`` and so on. Raises `UserError` for a file
    that cannot be written.
    """
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for n, runs in enumerate(groups, start=1):
            place = PurePosixPath(".") if n == 1 else PurePosixPath(f"group{n}")
            for run in runs:
                folder = place / run.experiment / f"seed{run.seed}"
                anchors = run.anchors.values() if run is runs[0] else ()
                counts = {f"{TALLIES}/{each.name}.npz": each for each in (run.counts, *anchors)}
                for file in sorted(run.path.glob(f"*/{TALLIES}/*.npz")):
                    counts[file.relative_to(run.path).as_posix()] = Counts.read(file)

                further = sorted(path.parent.name for path in run.path.glob(f"*/{TALLIES}"))
                for name in (*FILES, *(f"{each}/{each}.csv" for each in further)):
                    if (run.path / name).is_file():
                        _add(archive, folder / name, (run.path / name).read_bytes())
                for name, each in counts.items():
                    _add(archive, folder / name, _packed(each, without))


def publish_flights(
    perceptions: Sequence[Perception], windows: Mapping[str, Mapping[str, Windows]], path: Path
) -> None:
    """Writes ``<stratum>/<name>/<set>`` of all perceptions into an archive: their flights, and the
    counts of frames by map and their ``windows`` in place of the counts by second.

    Raises `UserError` for a file that cannot be written.
    """
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for each in perceptions:
            for frames, place in each.frames.items():
                folder = PurePosixPath(each.stratum) / each.name / frames
                for name in (CONFIG, FLIGHTS):
                    if (place.parent / name).is_file():
                        _add(archive, folder / name, (place.parent / name).read_bytes())
                _add(archive, folder / MAPS, _packed(counts_by_map(place), ()))
                if frames == "flown" and each.name in windows:
                    _add(archive, folder / WINDOWS, packed_windows(windows[each.name]))


def _packed(counts: Counts, without: Collection[str]) -> bytes:
    """Returns the file of some counts, uncompressed: the archive packs it tighter than numpy."""
    tables = {name: table for name, table in counts.tables.items() if name not in without}
    with tempfile.TemporaryDirectory() as folder:
        replace(counts, tables=tables).write(file := Path(folder) / "counts.npz", compressed=False)
        return file.read_bytes()


def _add(archive: zipfile.ZipFile, name: PurePosixPath, content: bytes) -> None:
    # A fixed date, so that the same runs give the same bytes.
    member = zipfile.ZipInfo(str(name), date_time=(1980, 1, 1, 0, 0, 0))
    archive.writestr(member, content, zipfile.ZIP_LZMA)


@contextmanager
def unpacked(places: Sequence[Path]) -> Iterator[tuple[list[Path], Naming]]:
    """Yields the folder of every place, where archives are unpacked until the block ends.

    ``runs.zip`` is an archive, and so is ``runs`` where only ``runs.zip`` exists; places below it,
    as ``runs/skyocc/seed0``, are found in it. The second thing that it yields puts an archive's
    name into a text in place of its folder; errors that leave the block have it, too. Raises
    `UserError` for a file that is no archive of a study.
    """
    with ExitStack() as stack:
        folders: dict[Path, Path] = {}
        found = []
        for place in places:
            archive = _archive_of(place)
            if archive is None:
                found.append(place)
                continue
            if archive not in folders:
                folders[archive] = Path(stack.enter_context(tempfile.TemporaryDirectory()))
                _unpack(archive, folders[archive])
            inside = place.relative_to(archive.with_suffix("")) if place != archive else "."
            found.append(folders[archive] / inside)

        def named(text: str) -> str:
            # The reader knows the archive, and not where it was unpacked.
            for archive, folder in folders.items():
                text = text.replace(str(folder), str(archive))
            return text

        try:
            yield found, named
        except UserError as error:
            raise UserError(named(str(error))) from error


def _archive_of(place: Path) -> Path | None:
    """Returns the archive that a place is, or lies in; ``None`` for what is there itself."""
    if place.is_file() and place.suffix == ENDING:
        return place
    if not place.exists():
        for folder in (place, *place.parents):
            archive = folder.with_name(f"{folder.name}{ENDING}") if folder.name else folder
            if archive.is_file():
                return archive
    return None


def _unpack(path: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            # The sizes that it declares; zipfile stops where a member is larger than it says.
            if sum(member.file_size for member in members) > LARGEST:
                raise ValueError(f"it holds more than {LARGEST:,} bytes")
            names = {PurePosixPath(member.filename).name for member in members}
            if not names & {CONFIG, FLIGHTS}:
                raise ValueError("it holds no run and no flights")
            # Whatever the names of its members are, zipfile writes files in the folder alone.
            archive.extractall(folder)
    except NO_ARCHIVE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"{path}: is no archive of a study ({reason}); make it with task.publish=true"
        ) from error
