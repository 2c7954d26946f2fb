"""Run folders as a report finds them: scored, or not finished."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..errors import UserError
from ..metrics.tally import Tally
from ..provenance import digest_of
from ..run_folder import CONFIG, METRICS, RESULTS, SESSIONS, TALLIES, read_config, recorded_code
from .ladder import ANCHORS, value_at
from .results import read_results

SEED, ASIDE = re.compile(r"seed\d+"), re.compile(r"\.before\d+$")
DEPTH = 4
"""Levels from a folder that is named down to its runs, at most: those of a published report may lie
in ``runs/group2/<experiment>/seed<k>``."""
UNKNOWN_CODE = "unknown code"
NEEDED = {
    **{"name": str, "seed": int, "data.frames": int},
    **{"data.test_clips": list, "model.encoder.projection": str},
}
"""What a report reads of a run's configuration."""


@dataclass(frozen=True)
class ScoredRun:
    """A finished run: its configuration, what it was scored, and the anchors scored beside it.

    ``files`` are digests of the code that trained it, empty where none were kept; ``row`` is its
    row of the whole test split in ``results.csv``.
    """

    path: Path
    config: dict
    files: dict[str, str]
    row: pd.Series
    tally: Tally
    anchors: dict[str, Tally]

    @property
    def experiment(self) -> str:
        return self.config["name"]

    @property
    def seed(self) -> int:
        return self.config["seed"]

    @property
    def code_digest(self) -> str:
        """Of all that trained it; empty where nothing was kept."""
        # Before format 2 of checkpoints one digest was kept, of all files.
        return self.files.get("") or (digest_of(self.files) if self.files else "")

    @property
    def code(self) -> str:
        """In words; `UNKNOWN_CODE` where no digest was kept."""
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
    """The run folders that are named, or lie below the named folders, each once.

    What lies below ``out``, hidden folders and runs that were moved aside are passed over. Raises
    `UserError` for a place that holds none.
    """
    found: dict[Path, Path] = {}
    for place in places:
        if not place.is_dir():
            raise UserError(f"{place}: no such folder; train first, or name runs in task.runs")
        below = list(_below(place, out.resolve(), DEPTH))
        if not below:
            raise UserError(f"{place}: holds no run folder; train first, or name runs in task.runs")
        found |= {path.resolve(): path for path in below}
    return list(found.values())


def _below(folder: Path, out: Path, depth: int) -> Iterator[Path]:
    if (folder / CONFIG).is_file() or SEED.fullmatch(folder.name):
        yield folder
    elif depth:
        for child in sorted(folder.iterdir()):
            passed = child.name.startswith(".") or ASIDE.search(child.name)
            if child.is_dir() and not passed and child.resolve() != out:
                yield from _below(child, out, depth - 1)


def read_run(path: Path) -> ScoredRun | UnfinishedRun:
    """What a run folder holds. Raises `UserError` that names the file which cannot be read."""
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
    tallies = path / TALLIES
    anchors = [anchor for anchor in ANCHORS if (tallies / f"{anchor}.npz").is_file()]
    return ScoredRun(
        path,
        config,
        recorded_code(path),
        own.iloc[0],
        Tally.read(tallies / f"{name}.npz"),
        {anchor: Tally.read(tallies / f"{anchor}.npz") for anchor in anchors},
    )


def _epochs_logged(path: Path) -> int | None:
    """How many epochs a run has begun; ``None`` where no log can be read."""
    # The logs of sessions are joined when training ends, or is interrupted in good order.
    last = 0
    for log in (path / METRICS, *path.glob(f"{SESSIONS}/*/{METRICS}")):
        try:
            last = max(last, int(pd.read_csv(log)["epoch"].max()) + 1)
        except (OSError, ValueError, KeyError):
            continue
    return last or None
