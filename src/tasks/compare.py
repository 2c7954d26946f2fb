"""task=compare: scored runs beside each other, with paired intervals, and how far their ranking
depends on the parameters of KAR-mIoU."""

import math
from collections import defaultdict
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import pandas as pd
import torch
from omegaconf import DictConfig
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..errors import UserError
from ..metrics.intervals import resamplings, score_differences, score_intervals
from ..metrics.protocol import require_same_protocol
from ..metrics.suite import FLAT
from ..metrics.tally import Tally
from ..report.ladder import ANCHORS
from ..report.scores import write_table
from ..report.sensitivity import draw_sensitivity, sensitivity_table
from ..run_folder import TALLIES

SHOWN = ("miou", "miou_occupied", "kar_miou", "collision_miss_rate", "geometric_iou", "ray_iou")


def compare(cfg: DictConfig, runs: list[str], out: str, clips: Sequence[str] = ()) -> None:
    """Writes ``differences.csv``, ``sensitivity.csv`` and ``sensitivity.png`` to ``out``, and
    prints the scores of all runs and their differences from the first.

    Only the clips like one of the patterns in ``clips`` count, as ``old_town/*``; without a
    pattern, all. Raises `UserError` for fewer than two runs, for runs of other protocols or clips,
    and for a pattern that no scored clip is like.
    """
    tallies = _tallies(runs)
    first, *others = tallies
    require_same_protocol({name: tally.protocol for name, tally in tallies.items()})
    for name in others:
        if not tallies[name].has_frames_of(tallies[first]):
            raise UserError(f"{name}: has other clips or frames than {first}; score both alike")
    if clips:
        like = _clips_like(list(map(str, clips)), tallies[first])
        tallies = {name: tally.of_clips(like.__contains__) for name, tally in tallies.items()}
    table = _differences(tallies)
    folder = Path(out)
    write_table(table, folder / "differences.csv")
    ranked = sensitivity_table(tallies)
    write_table(ranked, folder / "sensitivity.csv")
    draw_sensitivity(ranked, list(tallies), folder / "sensitivity.png")
    console = Console(width=110)
    console.print(_printed(table, list(tallies), len(tallies[first].rows())))
    always = ranked[[f"rank {name}" for name in tallies]].drop_duplicates()
    console.print(
        f"{len(ranked)} settings of KAR-mIoU rank the runs in {len(always)} order"
        + "s" * (len(always) > 1)
    )
    console.print(str(folder), highlight=False, soft_wrap=True)


def _tallies(runs: list[str]) -> dict[str, Tally]:
    """The tallies that run folders, score folders or files hold, by a name of their own."""
    if len(runs) < 2:
        raise UserError("task.runs: name two or more, as task.runs=[A,B]")
    found, folders = [], []
    for path in map(Path, runs):
        if not path.exists():
            raise UserError(f"task.runs: {path} is neither a folder nor a file")
        files = [path] if path.is_file() else sorted((path / TALLIES).glob("*.npz"))
        own = [file for file in files if len(files) == 1 or file.stem not in ANCHORS]
        if len(own) != 1:
            raise UserError(f"{path}: holds {len(own)} scored runs; name one of its tally files")
        found.append(Tally.read(own[0]))
        folders.append(own[0].parent.parent)
    return dict(zip(_names(found, folders), found))


def _clips_like(patterns: Sequence[str], tally: Tally) -> set[str]:
    """The scored clips that are like one of the patterns."""
    scored = [tally.clips[row] for row in tally.rows()]
    found: set[str] = set()
    for pattern in patterns:
        like = {clip for clip in scored if fnmatchcase(clip, pattern)}
        if not like:
            raise UserError(
                f"task.clips: no scored clip is like {pattern!r}; there are {scored[0]} to "
                f"{scored[-1]} ({len(scored)} clips)"
            )
        found |= like
    return found


def _names(tallies: list[Tally], folders: list[Path]) -> list[str]:
    """Names of runs; those of one name are told apart by what differs in their folders' paths."""
    alike = defaultdict(list)
    for n, tally in enumerate(tallies):
        alike[tally.name].append(n)
    names = [tally.name for tally in tallies]
    for name, rows in alike.items():
        if len(rows) > 1:
            for row, part in zip(rows, _told_apart([folders[row] for row in rows])):
                names[row] = f"{name} {part}"
    return names


def _told_apart(paths: list[Path]) -> list[str]:
    """The parts in which paths differ, such as the seed; whole paths where these do not align."""
    parts = [path.parts for path in paths]
    differing = [n for n, column in enumerate(zip(*parts)) if len(set(column)) > 1]
    short = ["/".join(each[n] for n in differing) for each in parts]
    aligned = len(set(map(len, parts))) == 1 and len(set(short)) == len(paths)
    return short if aligned else [str(path) for path in paths]


def _differences(tallies: dict[str, Tally]) -> pd.DataFrame:
    """Every score of every run with its interval, and its difference from the first run's."""
    (first, reference), *_ = tallies.items()
    suite, settings = reference.suite(), reference.protocol.suite
    rows = reference.rows()
    generator = torch.Generator().manual_seed(settings["seed"])
    weights = resamplings(len(rows), settings["resamples"], generator)
    lines = []
    for name, tally in tallies.items():
        for metric in (each for each in FLAT if each in reference.tables and each in tally.tables):
            ours, theirs = (
                {key: table[rows] for key, table in each.tables[metric].items()}
                for each in (reference, tally)
            )
            meaning, level = suite.metric(metric), settings["level"]
            found = score_intervals(meaning, theirs, weights, level)
            apart = score_differences(meaning, ours, theirs, weights, level)
            lines += [(name, score, *found[score], *apart[score]) for score in found]
    columns = ["run", "score", "value", "low", "high"]
    columns += [f"minus {first}", "difference_low", "difference_high", "same_sign"]
    return pd.DataFrame(lines, columns=columns)


def _printed(table: pd.DataFrame, runs: list[str], clips: int) -> Table:
    """The main scores in percent, with their intervals."""
    first = runs[0]
    printed = Table(box=box.SIMPLE_HEAD, padding=(0, 1), title_justify="left")
    over = f"{clips} clip{'s' * (clips > 1)}"
    printed.title = f"Scores (%) with intervals over {over}, and differences from {first}"
    printed.add_column("score", no_wrap=True)
    printed.add_column("run", overflow="fold")
    for name in ("value", "difference", "same sign"):
        printed.add_column(name, justify="right", no_wrap=True)
    for score in SHOWN:
        for n, row in enumerate(table[table["score"] == score].itertuples(index=False)):
            run, _, value, low, high, minus, minus_low, minus_high, same = row
            cells = [_with_bounds(value, low, high)]
            if run != first:
                sure = "–" if math.isnan(same) else f"{same:.2f}"
                cells += [_with_bounds(minus, minus_low, minus_high, "+"), sure]
            printed.add_row("" if n else score, run, *map(escape, cells))
        printed.add_section()
    return printed


def _with_bounds(value: float, low: float, high: float, sign: str = "") -> str:
    """In percent; of one clip there are no bounds, and a score may not exist."""
    if math.isnan(value):
        return "–"
    texts = [format(100 * number, f"{sign}.1f") for number in (value, low, high)]
    return texts[0] if math.isnan(low) else "{} [{}, {}]".format(*texts)
