"""task=foretell: which offline score orders perceptions as their flights do."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import torch
from omegaconf import DictConfig

from src.errors import UserError
from src.results.files import write_table
from src.results.render import Cell, Table, print_table
from src.terminal import say, tracked
from studies.foretelling.correlation import ALL, FlownPerception, compared_with, foretelling
from studies.foretelling.figure import draw_foretelling, draw_standings
from studies.foretelling.foreseeing import foreseen
from studies.foretelling.windows import windows_of


def foretell(
    cfg: DictConfig,
    flights: Sequence[str],
    reference: str,
    against: str,
    scores: Mapping[str, str],
    resamples: int,
    out: str,
) -> None:
    """Writes ``correlations.csv``, ``perceptions.csv``, ``foreseen.csv`` and pictures of the first
    two to ``out``, and prints the correlations with collisions over all strata.

    ``flights`` are folders as `FlownPerception.all_below` reads them. Raises `UserError` where
    ``against`` is none of the ``scores``, for an end that is neither high nor low, and as
    `foretelling` does.
    """
    if against not in scores:
        raise UserError(f"task.against: {against} is not in task.scores")
    for name, end in scores.items():
        if end not in ("high", "low"):
            raise UserError(f"task.scores.{name}: {end}; say which end is better, high or low")
    folder, generator = Path(out), torch.Generator().manual_seed(0)
    perceptions = FlownPerception.all_below([Path(each) for each in flights])
    table, standings = foretelling(perceptions, reference, scores, against, resamples, generator)
    if table.empty:
        raise UserError("task.flights: fewer than three perceptions have scored frames; fly more")
    write_table(table, folder / "correlations.csv")
    write_table(standings, folder / "perceptions.csv")

    compared, of_reference = compared_with(reference, perceptions)
    counted = [each for each in perceptions if each.windows]
    windows = {
        each.name: windows_of(each.windows, scores)
        for each in tracked(counted, "scoring the seconds of flights")
    }
    flown = [each for each in compared if each.name in windows]
    if flown:
        foresight = foreseen(flown, windows, of_reference, scores, resamples, generator)
        write_table(foresight, folder / "foreseen.csv")

    draw_foretelling(table, folder / "correlations.png")
    for frames, of_set in standings.groupby("frames"):
        draw_standings(of_set, table, scores, reference, folder / f"perceptions_{frames}.png")
    for frames in dict.fromkeys(table["frames"]):
        print_table(_printed(table, frames, against))
        if missing := [each.name for each in compared if frames not in each.frames]:
            say(f"without frames {frames}: {', '.join(missing)}")
    say(folder)


def _printed(table: pd.DataFrame, frames: str, against: str) -> Table:
    """Returns the correlations of a set of frames with collisions, over all strata, times 100."""
    shown = (table["frames"] == frames) & (table["stratum"] == ALL)
    kept = table[shown & (table["target"] == "collisions")]
    numbers = kept.select_dtypes("number") * 100

    rows = []
    for score, row in zip(kept["score"], numbers.to_dict("records")):
        own = Cell(row["spearman"], row["low"], row["high"])
        ends = row["difference"], row["difference_low"], row["difference_high"]
        apart = None if score == against else Cell(*ends, signed=True)
        rows.append((score, [own, Cell(row["kendall"]), apart]))

    columns = ["Spearman", "Kendall", f"beyond {against}'s"]
    count = kept["perceptions"].iloc[0]
    title = f"Correlation with fewer collisions (x 100), frames {frames}, {count} perceptions"
    return Table("foretelling", title, "", columns, rows, "score")
