"""What scoring leaves: ``results.csv``, one wide row a part, ``scores.csv``, and the counts."""

import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

import pandas as pd
import torch

from ..atomic import replacing
from ..errors import UserError, reason_of, way_out_of
from ..ontology import CLASSES
from ..provenance import digest_of
from ..run_folder import SCORES as LONG
from ..run_folder import TALLIES, UNKNOWN_RECIPE
from .bootstrap import interval_of, resamplings
from .counts import Counts, Parts

MEANS = ("miou", "miou_occupied", "kar_miou")
# Scores are shares in [0, 1], NaN where a class never occurs.
SCORES = (*MEANS, *(f"iou/{name}" for name in CLASSES), *(f"kar_iou/{name}" for name in CLASSES))
NUMBERS = {"seed": int, "parameters": int, **dict.fromkeys((*SCORES, "seconds"), float)}

# ``protocol`` names a file beside the table: what was counted, and how. ``precision`` is what the
# network really computed with. The anchors are the experiments ``all_free`` and ``voxel_prior``.
COLUMNS = (
    *("experiment", "scale", "seed", "split", "recipe"),
    *SCORES,
    *("protocol", "seconds", "parameters", "precision", "code_version", "git_commit", "dataset"),
)
# The long table of a run; the condition of a split that was presented as it was recorded.
LONG_KEYS = ("experiment", "seed", "condition", "part", "score")
LONG_VALUES = ("value", "low", "high", "clips", "frames", "protocol", "recipe")
AS_RECORDED = "as recorded"
TEXTS = tuple(name for name in COLUMNS if name not in NUMBERS)

# What heads the columns of a printed table.
SHORT_NAMES = dict(
    zip(CLASSES, ("build.", "ground", "veget.", "thin", "large", "car", "VRU", "general", "free"))
)


def result_rows(counts: Counts, parts: Parts, facts: Mapping[str, object]) -> list[dict]:
    """Returns a row of ``results.csv`` for each part that has a frame.

    ``facts`` are the columns that are no scores.
    """
    rows = []
    for part, chosen in parts.items():
        if clips := counts.rows(chosen):
            scores = counts.scores("occupancy", clips)
            # Through float32, as the metric itself gives them, to the last bit.
            values = {name: float(scores[name].float()) for name in SCORES}
            own = {"experiment": counts.name, "recipe": counts.recipe, "split": part}
            rows.append({**facts, **own, "protocol": counts.protocol.digest, **values})
    return rows


def run_table(runs: Mapping[int, Sequence[Counts]], parts: Parts) -> pd.DataFrame:
    """Returns the long table of what one command has scored: its counts by seed, on each part."""
    rows = []
    for seed, scored in runs.items():
        for counts, (part, chosen) in product(scored, parts.items()):
            if clips := counts.rows(chosen):
                key = (counts.name, str(seed), AS_RECORDED, part)
                rows += [(*key, *score) for score in _scores(counts, clips)]
    return pd.DataFrame(rows, columns=[*LONG_KEYS, *LONG_VALUES])


def _scores(counts: Counts, rows: list[int]) -> Iterator[tuple]:
    """Yields the name of every score of some rows, its interval, and what it rests on."""
    settings = counts.protocol.suite
    generator = torch.Generator().manual_seed(settings["seed"])
    weights = resamplings(len(rows), settings["resamples"], generator)
    frames = sum(counts.frames[row] for row in rows)
    facts = (len(rows), frames, counts.protocol.digest, counts.recipe)

    for samples in counts.samples(rows, weights).values():
        for score, sample in samples.items():
            # A single clip leaves nothing to draw: the score stands alone, without bounds.
            kept = sample if len(rows) > 1 else sample[:1]
            yield score, *interval_of(kept, settings["level"]), *facts


def write_scores(folder: Path, runs: Mapping[int, Sequence[Counts]], parts: Parts) -> pd.DataFrame:
    """Writes ``scores.csv``, ``tallies/<experiment>.npz`` and the protocols, each as a JSON file
    named by its hash, into a folder; returns the table.

    ``runs`` are the counts by their seed. Each file is replaced as a whole. Raises `UserError`
    where one cannot be written.
    """
    for counts in (each for scored in runs.values() for each in scored):
        counts.write(folder / TALLIES / f"{counts.name}.npz")
        with replacing(folder / f"protocol-{counts.protocol.digest}.json") as temporary:
            temporary.write_text(counts.protocol.to_json(indent=1) + "\n")
    table = run_table(runs, parts)
    write_table(table, folder / LONG)
    return table


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Writes a CSV; the file is replaced as a whole. Raises `UserError` where it cannot be."""
    with replacing(path) as temporary:
        table.to_csv(temporary, index=False, lineterminator="\n")


def write_results(path: str | Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Writes rows that hold exactly `COLUMNS`.

    The file is replaced as a whole or not at all, and reads back to the same floats. Raises
    `UserError` where it cannot be written.
    """
    for row in rows:
        if set(row) != set(COLUMNS):
            raise ValueError(f"a row of results differs in {sorted(set(row) ^ set(COLUMNS))}")

    write_table(pd.DataFrame(rows, columns=list(COLUMNS)), Path(path))


def read_results(path: str | Path) -> pd.DataFrame:
    """Reads a ``results.csv``, typed: texts as strings, scores as floats with NaN. Files from
    before there were recipes have an unknown one.

    Raises `UserError` for a file that is missing, cut off, or not a table of results.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        # As text first, because pandas 2 parses floats inexactly.
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows that are too long
            table = _as_text(text)
        table = table.astype({name: kind for name, kind in NUMBERS.items() if name in table})
        if "recipe" not in table:
            table["recipe"] = UNKNOWN_RECIPE
        if "protocol" in table:  # once the text itself
            is_text = table["protocol"].str.startswith("{", na=False)
            table.loc[is_text, "protocol"] = table.loc[is_text, "protocol"].map(digest_of)
        _require_whole(table, text)
    except FileNotFoundError as error:
        raise UserError(f"{path}: no such file; finish the run or run task=test first") from error
    except (OSError, ValueError, pd.errors.ParserWarning) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        way_out = way_out_of(error, "move it away and run it again", path)
        raise UserError(f"{path}: not a readable results file ({reason}); {way_out}") from error
    return table[list(COLUMNS)].fillna({"git_commit": ""})


def read_scores(path: str | Path) -> pd.DataFrame:
    """Reads a ``scores.csv``: names as texts, numbers as floats. Raises `UserError` where it cannot
    be read."""
    numbers = dict.fromkeys(("value", "low", "high"), float)
    try:
        table = _as_text(Path(path).read_text(encoding="utf-8"))
        return table.astype({name: kind for name, kind in numbers.items() if name in table})
    except (OSError, ValueError) as error:
        way_out = way_out_of(error, "run it again")
        raise UserError(f"{path}: cannot be read ({reason_of(error)}); {way_out}") from error


def _as_text(text: str) -> pd.DataFrame:
    """Reads a CSV as strings, and empty cells as missing: an experiment may be called ``NA``."""
    return pd.read_csv(
        io.StringIO(text), dtype=str, index_col=False, keep_default_na=False, na_values=[""]
    )


def _require_whole(table: pd.DataFrame, text: str) -> None:
    """Raises `ValueError` for a table of results that lacks a column, a value or its end."""
    if missing := [name for name in COLUMNS if name not in table]:
        raise ValueError(f"it has no column {missing[0]}")
    if not text.endswith("\n"):
        raise ValueError("its last line is cut off")
    for name in TEXTS:
        if name != "git_commit" and table[name].isna().any():
            raise ValueError(f"a row has no {name}")
