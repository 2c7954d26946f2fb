"""task=compare: scored runs beside each other, with paired intervals."""

import fnmatch
import math
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from ..errors import UserError
from ..metrics.suite import import_metrics
from ..results.bootstrap import interval_of, same_sign
from ..results.counts import Counts, require_comparable
from ..results.files import write_table
from ..results.render import Cell, Table, print_table, with_recipes
from ..results.scored import read_scored
from ..results.table import Resamples
from ..terminal import say

# Of all scores, which differences.csv has, these are printed.
PRINTED = ("miou", "miou_occupied", "kar_miou", "geometric_iou", "primitive_miss", "ray_iou")


def compare(cfg: DictConfig, runs: list[str], out: str, clips: Sequence[str] = ()) -> None:
    """Writes ``differences.csv`` to ``out``, and prints the scores of all runs and their
    differences from the first.

    Only the clips like one of the patterns in ``clips`` count, as ``old_town/*``; without a
    pattern, all. Raises `UserError` for fewer than two runs, for runs of other protocols, clips or
    labels, and for a pattern that no scored clip is like.
    """
    import_metrics(cfg.suite)
    if len(runs) < 2:
        raise UserError("task.runs: name two or more, as task.runs=[A,B]")
    scored = read_scored(list(map(str, runs)))
    require_comparable(scored)
    if clips:
        chosen = _clips_like(list(map(str, clips)), next(iter(scored.values())))
        scored = {name: counts.of_clips(chosen.__contains__) for name, counts in scored.items()}

    folder, table = Path(out), _differences(scored)
    write_table(table, folder / "differences.csv")
    print_table(_printed(table, len(next(iter(scored.values())).rows())))
    say(folder)


def _clips_like(patterns: Sequence[str], counts: Counts) -> set[str]:
    """Returns the scored clips that are like one of the patterns."""
    scored = [counts.clips[row] for row in counts.rows()]
    chosen: set[str] = set()
    for pattern in patterns:
        like = fnmatch.filter(scored, pattern)
        if not like:
            raise UserError(
                f"task.clips: no scored clip is like {pattern!r}; there are {scored[0]} to "
                f"{scored[-1]} ({len(scored)} clips)"
            )
        chosen.update(like)
    return chosen


def _differences(scored: Mapping[str, Counts]) -> pd.DataFrame:
    """Returns every score of every run with its interval, and its difference from the first's."""
    first = next(iter(scored))
    # Every run is an experiment of one seed, so that all are scored on the same draws of clips.
    drawn = Resamples({name: {0: counts} for name, counts in scored.items()})
    samples = {name: by_seed[0] for name, by_seed in drawn.samples.items()}
    # A single clip leaves nothing to draw.
    kept = slice(None) if drawn.clips > 1 else slice(1)

    lines = []
    for name, of_run in samples.items():
        for score in (score for score in of_run if score in samples[first]):
            change = (of_run[score] - samples[first][score])[kept]
            intervals = (interval_of(each, drawn.level) for each in (of_run[score][kept], change))
            key = (name, drawn.recipes[name], score)
            lines.append((*key, *chain(*intervals), same_sign(change)))
    columns = ["run", "recipe", "score", "value", "low", "high"]
    columns += [f"minus {first}", "difference_low", "difference_high", "same_sign"]
    return pd.DataFrame(lines, columns=columns)


def _printed(table: pd.DataFrame, clips: int) -> Table:
    """Returns the main scores in percent, with their intervals."""
    first, rows, lines, recipes = table["run"].iloc[0], [], [], []
    for score in PRINTED:
        lines.append(len(rows))
        for row in table[table["score"] == score].itertuples(index=False):
            run, recipe, _, *numbers, same = row
            recipes.append(recipe)
            percent = [100 * number for number in numbers]
            sure = "–" if math.isnan(same) else f"{same:.2f}"
            beside = [Cell(*percent[3:], signed=True), sure] if run != first else [None, None]
            rows.append((f"{score}, {run}", [Cell(*percent[:3]), *beside]))

    title = f"Scores (%) with intervals (clips: {clips}), and differences from {first}"
    columns = ["value", "difference", "same sign"]
    shown = Table("differences", title, "", columns, rows, "score, run", lines=tuple(lines[1:]))
    return with_recipes(shown, recipes)
