"""Run folders as a report finds them: scored, or not finished."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..dotted import value_at
from ..errors import UserError
from ..provenance import digest_of
from ..run_folder import (
    ANCHORS,
    ASIDE,
    CONFIG,
    METRICS,
    RESULTS,
    SESSIONS,
    TALLIES,
    read_config,
    recorded_code,
)
from .counts import Counts
from .files import read_results

SEED = re.compile(r"seed\d+")

# Levels from a folder that is named down to its runs, at most: one more than in
# ``runs/<scale>/<experiment>/seed<k>``.
DEPTH = 4

UNKNOWN_CODE = "unknown code"

# The keys of a run's configuration that a report reads, and their types.
NEEDED = {
    **{"name": str, "seed": int, "data.frames": int},
    **{"data.test_clips": list, "model.encoder.projection": str},
}


@dataclass(frozen=True)
class ScoredRun:
    """A finished run: its configuration, its counts, and the anchors scored beside it.

    ``files`` are digests of the code that trained it, empty where none were kept; ``row`` is its
    row of the whole test split in ``results.csv``.
    """

    path: Path
    config: dict
    files: dict[str, str]
    row: pd.Series
    counts: Counts
    anchors: dict[str, Counts]

    @property
    def experiment(self) -> str:
        return self.config["name"]

    @property
    def seed(self) -> int:
        return self.config["seed"]

    @property
    def code_digest(self) -> str:
        """The digest of all code that trained the run; empty where nothing was kept."""
        # Before format 2 of checkpoints one digest was kept, of all files.
        return self.files.get("") or (digest_of(self.files) if self.files else "")

    @property
    def code(self) -> str:
        """The code that trained the run, in words; `UNKNOWN_CODE` where no digest was kept."""
        return f"code {self.code_digest}" if self.files else UNKNOWN_CODE

    def __str__(self) -> str:
        return f"{self.experiment} seed {self.seed}"


class UnfinishedRun(NamedTuple):
    """A run without results; ``epochs`` were begun, as far as its log says."""

    path: Path
    experiment: str
    seed: int
    epochs: int | None
    of_epochs: int | None

    def __str__(self) -> str:
        whole = "" if self.of_epochs is None else f" of {self.of_epochs}"
        begun = "no epoch" if self.epochs is None else f"{self.epochs}{whole} epochs"
        return f"{self.experiment} seed {self.seed}: unfinished, {begun} logged"


def run_folders(places: Sequence[Path], out: Path) -> list[Path]:
    """Returns the run folders that are named, or lie below the named folders, each once.

    What lies below ``out``, hidden folders and runs that were moved aside are passed over. Raises
    `UserError` for a place that holds none.
    """
    folders: dict[Path, Path] = {}

    for place in places:
        if not place.is_dir():
            if place.is_file():
                unpack = f"python -m tarfile -e {place} FOLDER"
                raise UserError(f"{place}: is a file; unpack an archive first: {unpack}")
            raise UserError(f"{place}: no such folder; train first, or name runs in task.runs")
        below = list(_below(place, out.resolve(), DEPTH))
        if not below:
            raise UserError(f"{place}: holds no run folder; train first, or name runs in task.runs")
        # A run that two places hold is one run.
        folders |= {path.resolve(): path for path in below}
    return list(folders.values())


def _below(folder: Path, out: Path, depth: int) -> Iterator[Path]:
    if (folder / CONFIG).is_file() or SEED.fullmatch(folder.name):
        yield folder
    elif depth:
        for child in sorted(folder.iterdir()):
            passed = child.name.startswith(".") or ASIDE.search(child.name)
            if child.is_dir() and not passed and child.resolve() != out:
                yield from _below(child, out, depth - 1)


def read_run(path: Path) -> ScoredRun | UnfinishedRun:
    """Reads a run folder. Raises `UserError` that names the file which cannot be read."""
    so = "so this is no run's folder; move it away, or name the others in task.runs"
    config = read_config(path / CONFIG, so)
    for key, kind in NEEDED.items():
        if not isinstance(value_at(config, key), kind):
            raise UserError(f"{path / CONFIG}: has no {key}, {so}")
    name, seed = config["name"], config["seed"]

    if not (path / RESULTS).is_file():
        of_epochs = value_at(config, "trainer.max_epochs")
        return UnfinishedRun(path, name, seed, _epochs_logged(path), of_epochs)
    table = read_results(path / RESULTS)
    own = table[(table["experiment"] == name) & (table["split"] == "test")]
    if own.empty:
        raise UserError(
            f"{path / RESULTS}: has no test scores of {name}, only of "
            f"{', '.join(table['experiment'].unique()) or 'nothing'}; run it again"
        )

    files = {each: path / TALLIES / f"{each}.npz" for each in (name, *ANCHORS)}
    counts = Counts.read(files.pop(name))
    anchors = {anchor: Counts.read(file) for anchor, file in files.items() if file.is_file()}
    return ScoredRun(path, config, recorded_code(path), own.iloc[0], counts, anchors)


def _epochs_logged(path: Path) -> int | None:
    """Returns the number of epochs that a run has begun; ``None`` where no log can be read."""
    # The logs of sessions are joined when training ends, or is interrupted in good order.
    last = 0
    for log in (path / METRICS, *path.glob(f"{SESSIONS}/*/{METRICS}")):
        try:
            last = max(last, int(pd.read_csv(log)["epoch"].max()) + 1)
        except (OSError, ValueError, KeyError):
            continue
    return last or None
