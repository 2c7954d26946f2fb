"""What a flight scored in every two seconds of it."""

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from src.data.files import BROKEN
from src.errors import UserError
from src.results.counts import Counts

# A window is of two whole seconds.
WINDOW_S = 2
# All windows of a perception, as they were published in place of its counts by second.
WINDOWS = "windows.npz"

# By score what it was in the window that ends with each second; NaN where it counted nothing.
Windows = Mapping[str, Float32[np.ndarray, "seconds"]]


def windows_of(place: Path, scores: Collection[str]) -> dict[str, Windows]:
    """Returns some scores of all windows, by flight. No window ends with the first second.

    ``place`` is a folder with counts by second, ``<map>/<flight>.npz``, or a published file of
    windows. Raises `UserError` for a score that there is not, and for a file that cannot be read.
    """
    if place.is_file():
        return _read(place, scores)
    found, suite = {}, None
    for path in sorted(place.glob("*/*.npz")):
        counts, values = Counts.read(path), {}
        # To make one takes longer than to use it, and all flights have the same.
        suite = suite or counts.suite()
        for metric, tables in counts.tables.items():
            sums = {name: table[1:] + table[:-1] for name, table in tables.items()}
            values |= suite.metric(metric).scores(sums)
        require_scores(scores, values, place)
        found[f"{path.parent.name}/{path.stem}"] = {
            score: np.r_[math.nan, values[score].numpy()].astype(np.float32) for score in scores
        }
    return found


def _read(path: Path, scores: Collection[str]) -> dict[str, Windows]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        flights, ends = arrays.pop("flights").tolist(), np.cumsum(arrays.pop("seconds"))[:-1]
        require_scores(scores, arrays, path)
        parts = {score: np.split(arrays[score], ends) for score in scores}
    except BROKEN as error:
        raise UserError(f"{path}: cannot be read ({error})") from error
    return {
        flight: {score: part[n] for score, part in parts.items()}
        for n, flight in enumerate(flights)
    }


def require_scores(scores: Collection[str], known: Collection[str], place: Path) -> None:
    """Raises `UserError` for a score that is not known of what lies at a place."""
    if missing := [score for score in scores if score not in known]:
        raise UserError(
            f"task.scores.{missing[0]}: no score of {place}; there are {', '.join(known)}"
        )
