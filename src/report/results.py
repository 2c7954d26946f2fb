"""``results.csv``: one row per evaluated split or part, and the tables printed from it."""

import io
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
from rich import box
from rich.console import Console
from rich.table import Table

from ..atomic import replacing
from ..errors import UserError
from ..ontology import CLASSES

MEANS = ("miou", "miou_occupied", "kar_miou")
SCORES = (
    *MEANS,
    *(f"iou/{name}" for name in CLASSES),
    *(f"kar_iou/{name}" for name in CLASSES),
)
TEXTS = (
    *("experiment", "scale", "split", "protocol", "precision"),
    *("code_version", "git_commit", "dataset"),
)
NUMBERS = {"seed": int, "parameters": int, **dict.fromkeys((*SCORES, "seconds"), float)}
COLUMNS = (
    *("experiment", "scale", "seed", "split"),
    *SCORES,
    *("protocol", "seconds", "parameters", "precision", "code_version", "git_commit", "dataset"),
)
"""Scores are shares in [0, 1], NaN where a class never occurs. ``protocol`` is compact JSON: what
was counted, and how. ``precision`` is what the network really computed with. The anchors are the
experiments ``all_free`` and ``voxel_prior``, which have none."""

WIDTH = 110
SHORT_NAMES = dict(
    zip(CLASSES, ("build.", "ground", "veget.", "thin", "large", "car", "VRU", "general", "free"))
)


def write_results(path: str | Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows that hold exactly `COLUMNS`; ``protocol`` may be a dict.

    The file is replaced as a whole or not at all, and reads back to the same floats. Raises
    `UserError` where it cannot be written.
    """
    for row in rows:
        if set(row) != set(COLUMNS):
            raise ValueError(f"a row of results differs in {sorted(set(row) ^ set(COLUMNS))}")
    table = pd.DataFrame([{**row, "protocol": _compact(row["protocol"])} for row in rows])
    with replacing(path) as temporary:
        table.reindex(columns=list(COLUMNS)).to_csv(temporary, index=False, lineterminator="\n")


def _compact(protocol: object) -> str:
    if isinstance(protocol, str):
        return protocol
    return json.dumps(protocol, sort_keys=True, separators=(",", ":"))


def read_results(path: str | Path) -> pd.DataFrame:
    """Rows of a ``results.csv``, typed: texts as strings, scores as floats with NaN.

    Raises `UserError` for a file that is missing, cut off, or not a table of results.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        # As text first: pandas 2's own parser of floats is not exact.
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows that are too long
            table = pd.read_csv(io.StringIO(text), dtype=str, index_col=False)
        table = table.astype({name: kind for name, kind in NUMBERS.items() if name in table})
    except FileNotFoundError as error:
        raise UserError(f"{path}: no such file; finish the run or run task=test first") from error
    except (OSError, ValueError, pd.errors.ParserWarning) as error:
        reason = str(error).splitlines()[0]
        raise _corrupt(path, reason) from error
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise _corrupt(path, f"it has no column {missing[0]}")
    if not text.endswith("\n"):
        raise _corrupt(path, "its last line is cut off")
    for name in TEXTS:
        if name != "git_commit" and table[name].isna().any():
            raise _corrupt(path, f"a row has no {name}")
    if not table["protocol"].map(_is_json).all():
        raise _corrupt(path, "a protocol is not JSON")
    table["git_commit"] = table["git_commit"].fillna("")
    return table[list(COLUMNS)]


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _corrupt(path: str | Path, reason: str) -> UserError:
    return UserError(f"{path}: not a readable results file ({reason}); delete it and run again")


def print_results(rows: pd.DataFrame, console: Console | None = None) -> None:
    """Print the mean scores side by side, then every class, as percentages; at most 110 columns.

    ``rows`` is what `read_results` returns, in the order to print. A dash is a score without any
    voxel to score (NaN); * marks the best of a split.
    """
    console = console or Console(width=WIDTH)
    console.print(_means_table(rows))
    console.print(_classes_table(rows))


def _means_table(rows: pd.DataFrame) -> Table:
    table = _table("Scores (%)", ("mIoU", "mIoU occupied", "KAR-mIoU"))
    table.caption = "mIoU counts free space too; * best of its split"
    for split, of_split in rows.groupby("split", sort=False):
        table.add_row(f"[bold]{split}[/bold]")
        for _, row in of_split.iterrows():
            table.add_row(*_names(row), *_percentages(row, of_split, MEANS))
        table.add_section()
    return table


def _classes_table(rows: pd.DataFrame) -> Table:
    table = _table("IoU of every class, and KAR-IoU below it (%)", list(SHORT_NAMES.values()))
    iou, kar_iou = ([f"{kind}/{name}" for name in CLASSES] for kind in ("iou", "kar_iou"))
    for split, of_split in rows.groupby("split", sort=False):
        table.add_row(f"[bold]{split}[/bold]")
        for _, row in of_split.iterrows():
            table.add_row(*_names(row), *_percentages(row, of_split, iou))
            table.add_row("", "KAR", *_percentages(row, of_split, kar_iou), style="dim")
        table.add_section()
    return table


def _table(title: str, scores: Sequence[str]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), title_justify="left")
    table.add_column("experiment", overflow="fold")
    table.add_column("seed", justify="right")
    for name in scores:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _names(row: pd.Series) -> tuple[str, str]:
    return f"  {row['experiment']}", str(row["seed"])


def _percentages(row: pd.Series, of_split: pd.DataFrame, names: Sequence[str]) -> list[str]:
    """Scores of a row as text, the best of its split in bold with a star, NaN as a dash."""
    cells = []
    for name in names:
        if pd.isna(row[name]):
            cells.append("– ")
        elif len(of_split) > 1 and row[name] == of_split[name].max() > 0:
            cells.append(f"[bold]{100 * row[name]:.1f}*[/bold]")
        else:
            cells.append(f"{100 * row[name]:.1f} ")
    return cells
