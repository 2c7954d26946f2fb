"""task=compare: scored runs beside each other, with paired intervals, and how far their ranking
depends on the parameters of KAR-mIoU."""

import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from ..errors import UserError
from ..metrics.protocol import require_same_protocol
from ..metrics.suite import import_metrics
from ..report.captions import counted
from ..report.sensitivity import draw_sensitivity, sensitivity_table
from ..results.archive import unpacked
from ..results.bootstrap import difference_of, interval_of
from ..results.counts import Counts
from ..results.files import write_table
from ..results.render import Cell, Table, print_table
from ..results.table import Resamples
from ..run_folder import ANCHORS, TALLIES
from ..terminal import say

# Of all scores, which differences.csv has, these are printed.
PRINTED = ("miou", "miou_occupied", "kar_miou", "collision_miss_rate", "geometric_iou", "ray_iou")


def compare(cfg: DictConfig, runs: list[str], out: str, clips: Sequence[str] = ()) -> None:
    """Writes ``differences.csv``, ``sensitivity.csv`` and ``sensitivity.png`` to ``out``, and
    prints the scores of all runs and their differences from the first.

    Only the clips like one of the patterns in ``clips`` count, as ``old_town/*``; without a
    pattern, all. Runs whose counts were published without those of other parameters of KAR-mIoU
    are compared without the sensitivity. Raises `UserError` for fewer than two runs, for runs of
    other protocols, clips or labels, and for a pattern that no scored clip is like.
    """
    import_metrics(cfg.suite)
    scored = _read(list(map(str, runs)))
    _require_comparable(scored)
    if clips:
        chosen = _clips_like(list(map(str, clips)), next(iter(scored.values())))
        scored = {name: counts.of_clips(chosen.__contains__) for name, counts in scored.items()}

    folder, table = Path(out), _differences(scored)
    write_table(table, folder / "differences.csv")
    print_table(_printed(table, len(next(iter(scored.values())).rows())))
    say(_sensitivity(scored, folder))
    say(folder)


def _sensitivity(scored: Mapping[str, Counts], folder: Path) -> str:
    """Writes how the ranking depends on the parameters of KAR-mIoU, and says it in a line."""
    table, figure = folder / "sensitivity.csv", folder / "sensitivity.png"
    without = [name for name, counts in scored.items() if "sensitivity" not in counts.tables]
    if without:
        for earlier in (table, figure):
            earlier.unlink(missing_ok=True)
        return f"no ranking under other parameters: {without[0]} has no counts for them"

    ranked = sensitivity_table(scored)
    write_table(ranked, table)
    draw_sensitivity(ranked, list(scored), figure)
    orders = len(ranked[[f"rank {name}" for name in scored]].drop_duplicates())
    return f"{len(ranked)} settings of KAR-mIoU rank the runs in {counted(orders, 'order')}"


def _require_comparable(scored: Mapping[str, Counts]) -> None:
    """Raises `UserError` for runs of other protocols, clips, frames or labels than the first's."""
    require_same_protocol({name: counts.protocol for name, counts in scored.items()})
    (first, reference), *others = scored.items()
    for name, counts in others:
        if other := counts.scored_on_other(reference):
            raise UserError(f"{name}: was scored on {other} than {first}; score both alike")


def _read(runs: Sequence[str]) -> dict[str, Counts]:
    """Reads the counts of run folders, score folders, archives or files, by a name of each."""
    if len(runs) < 2:
        raise UserError("task.runs: name two or more, as task.runs=[A,B]")
    with unpacked([Path(run) for run in runs]) as (places, _):
        files = [_file_of(place) for place in places]
        resolved = [file.resolve() for file in files]
        for n, run in enumerate(runs):
            if resolved[n] in resolved[:n]:
                raise UserError(f"task.runs: {run} is named twice")

        scored = [Counts.read(file) for file in files]
        return dict(zip(_names(scored, files, runs), scored))


def _file_of(path: Path) -> Path:
    """Returns the one file of counts of a run or score folder beside the anchors', or the file."""
    if not path.exists():
        raise UserError(f"task.runs: {path} is neither a folder nor a file")
    files = [path] if path.is_file() else sorted((path / TALLIES).glob("*.npz"))
    own = [file for file in files if len(files) == 1 or file.stem not in ANCHORS]
    if len(own) != 1:
        raise UserError(f"{path}: holds {len(own)} scored runs; name one of its files of counts")
    return own[0]


def _clips_like(patterns: Sequence[str], counts: Counts) -> set[str]:
    """Returns the scored clips that are like one of the patterns."""
    scored = [counts.clips[row] for row in counts.rows()]
    chosen: set[str] = set()
    for pattern in patterns:
        like = {clip for clip in scored if fnmatchcase(clip, pattern)}
        if not like:
            raise UserError(
                f"task.clips: no scored clip is like {pattern!r}; there are {scored[0]} to "
                f"{scored[-1]} ({len(scored)} clips)"
            )
        chosen |= like
    return chosen


def _names(scored: Sequence[Counts], files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """Returns names of runs. Those of one name are told apart by what differs in their files'
    paths, such as the seed, or by what was given where the paths do not align."""
    names = []
    for counts, file, words in zip(scored, files, given):
        # Seeds of one experiment have one name, and so have two scorings of one run.
        alike = [each for other, each in zip(scored, files) if other.name == counts.name]
        own = f" {_own_parts(file, alike) or words}" if len(alike) > 1 else ""
        names.append(counts.name + own)
    return names


def _own_parts(path: Path, alike: Sequence[Path]) -> str:
    """Returns the parts of a path in which paths differ; nothing for paths of several depths."""
    if len({len(each.parts) for each in alike}) > 1:
        return ""
    columns = zip(*(each.parts for each in alike))
    return "/".join(part for part, column in zip(path.parts, columns) if len(set(column)) > 1)


def _differences(scored: Mapping[str, Counts]) -> pd.DataFrame:
    """Returns every score of every run with its interval, and its difference from the first's."""
    first = next(iter(scored))
    # Every run is an experiment of one seed, so that all are scored on the same draws of clips.
    drawn = Resamples({name: {0: counts} for name, counts in scored.items()})
    samples = {name: by_seed[0] for name, by_seed in drawn.samples.items()}
    single = slice(None) if drawn.clips > 1 else slice(1)

    lines = []
    for name, of_run in samples.items():
        for score in (score for score in of_run if score in samples[first]):
            change = of_run[score] - samples[first][score]
            value = interval_of(of_run[score][single], drawn.level)
            lines.append((name, score, *value, *difference_of(change[single], drawn.level)))
    columns = ["run", "score", "value", "low", "high"]
    columns += [f"minus {first}", "difference_low", "difference_high", "same_sign"]
    return pd.DataFrame(lines, columns=columns)


def _printed(table: pd.DataFrame, clips: int) -> Table:
    """Returns the main scores in percent, with their intervals."""
    first, rows, lines = table["run"].iloc[0], [], []
    for score in PRINTED:
        lines.append(len(rows))
        for run, _, *numbers, same in table[table["score"] == score].itertuples(index=False):
            percent = [100 * number for number in numbers]
            sure = "–" if math.isnan(same) else f"{same:.2f}"
            beside = [Cell(*percent[3:], signed=True), sure] if run != first else [None, None]
            rows.append((f"{score}, {run}", [Cell(*percent[:3]), *beside]))

    over = counted(clips, "clip")
    title = f"Scores (%) with intervals over {over}, and differences from {first}"
    columns = ["value", "difference", "same sign"]
    return Table("differences", title, "", columns, rows, "score, run", lines=tuple(lines[1:]))
