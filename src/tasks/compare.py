"""task=compare: scored runs beside each other, with paired intervals, and how far their ranking
depends on the parameters of KAR-mIoU."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
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
from ..metrics.suite import import_metrics
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
    pattern, all. Runs whose counts were published without those of other parameters of KAR-mIoU
    are compared without the sensitivity. Raises `UserError` for fewer than two runs, for runs of
    other protocols, clips or labels, and for a pattern that no scored clip is like.
    """
    import_metrics(cfg.suite)
    tallies = _tallies(list(map(str, runs)))
    _require_comparable(tallies)
    if clips:
        like = _clips_like(list(map(str, clips)), next(iter(tallies.values())))
        tallies = {name: tally.of_clips(like.__contains__) for name, tally in tallies.items()}
    scored, table = len(next(iter(tallies.values())).rows()), _differences(tallies)
    folder, console = Path(out), Console(width=110)
    write_table(table, folder / "differences.csv")
    console.print(_printed(table, list(tallies), scored))
    console.print(_sensitivity(tallies, folder), soft_wrap=True, highlight=False)
    console.print(str(folder), highlight=False, soft_wrap=True)


def _sensitivity(tallies: Mapping[str, Tally], folder: Path) -> str:
    """Writes how the ranking depends on the parameters of KAR-mIoU, and says it in a line."""
    table, figure = folder / "sensitivity.csv", folder / "sensitivity.png"
    without = [name for name, tally in tallies.items() if "sensitivity" not in tally.tables]
    if without:
        for earlier in (table, figure):
            earlier.unlink(missing_ok=True)
        return f"no ranking under other parameters: {escape(without[0])} has no counts for them"
    ranked = sensitivity_table(tallies)
    write_table(ranked, table)
    draw_sensitivity(ranked, list(tallies), figure)
    orders = len(ranked[[f"rank {name}" for name in tallies]].drop_duplicates())
    plural = "s" * (orders > 1)
    return f"{len(ranked)} settings of KAR-mIoU rank the runs in {orders} order{plural}"


def _require_comparable(tallies: Mapping[str, Tally]) -> None:
    """Raises `UserError` for runs of other protocols, clips, frames or labels than the first's."""
    require_same_protocol({name: tally.protocol for name, tally in tallies.items()})
    (first, reference), *others = tallies.items()
    for name, tally in others:
        if other := tally.scored_on_other(reference):
            raise UserError(f"{name}: was scored on {other} than {first}; score both alike")


def _tallies(runs: Sequence[str]) -> dict[str, Tally]:
    """The tallies that run folders, score folders or files hold, by a name of their own."""
    if len(runs) < 2:
        raise UserError("task.runs: name two or more, as task.runs=[A,B]")
    files = [_tally_file(Path(run)) for run in runs]
    for n, file in enumerate(files):
        if file.resolve() in [earlier.resolve() for earlier in files[:n]]:
            raise UserError(f"task.runs: {runs[n]} is named twice")
    tallies = [Tally.read(file) for file in files]
    return dict(zip(_names(tallies, files, runs), tallies))


def _tally_file(path: Path) -> Path:
    """The one tally of a run or score folder beside the anchors', or the file itself."""
    if not path.exists():
        raise UserError(f"task.runs: {path} is neither a folder nor a file")
    files = [path] if path.is_file() else sorted((path / TALLIES).glob("*.npz"))
    own = [file for file in files if len(files) == 1 or file.stem not in ANCHORS]
    if len(own) != 1:
        raise UserError(f"{path}: holds {len(own)} scored runs; name one of its tally files")
    return own[0]


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


def _names(tallies: Sequence[Tally], files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """Names of runs; those of one name are told apart by what differs in their files' paths, such
    as the seed, or by what was given where the paths do not align."""
    alike = defaultdict(list)
    for n, tally in enumerate(tallies):
        alike[tally.name].append(n)
    names = [tally.name for tally in tallies]
    for name, rows in alike.items():
        if len(rows) > 1:
            parts = _differing([files[row] for row in rows]) or [given[row] for row in rows]
            for row, part in zip(rows, parts):
                names[row] = f"{name} {part}"
    return names


def _differing(paths: Sequence[Path]) -> list[str]:
    """The parts in which paths of one depth differ; nothing for paths of several depths."""
    parts = [path.parts for path in paths]
    if len(set(map(len, parts))) > 1:
        return []
    differing = [n for n, column in enumerate(zip(*parts)) if len(set(column)) > 1]
    return ["/".join(each[n] for n in differing) for each in parts]


def _differences(tallies: dict[str, Tally]) -> pd.DataFrame:
    """Every score of every run with its interval, and its difference from the first run's."""
    (first, reference), *_ = tallies.items()
    suite, settings = reference.suite(), reference.protocol.suite
    rows = reference.rows()
    generator = torch.Generator().manual_seed(settings["seed"])
    weights = resamplings(len(rows), settings["resamples"], generator)
    lines = []
    for name, tally in tallies.items():
        for metric in (each for each in reference.tables if each in tally.tables):
            if not suite.metric(metric).in_score_table:
                continue
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
