"""The card of a finished dataset: a page for people, figures, a table, and Croissant metadata."""

import json
from pathlib import Path

from ..atomic import replacing
from ..data.clip import SUMS, sha256_of
from ..data.croissant import croissant_of
from ..data.manifest import read_manifest
from ..data.statistics import statistics_of
from .animation import draw_flight
from .card_text import WHAT_IT_IS, card_text
from .contact_sheet import draw_contact_sheet
from .statistics_figure import draw_statistics

CARD, FIGURES, CROISSANT = "README.md", "card", "croissant.json"
CARD_SUMS = f"{FIGURES}/{SUMS}"


def write_card(root: Path) -> None:
    """Write ``README.md``, ``card/`` and ``croissant.json`` into a dataset's folder, and the
    SHA-256 of each of these files.

    Everything comes from the files there, and the same dataset gives the same bytes. Raises
    `UserError` where the dataset is unfinished, a file cannot be read, or nothing can be written.
    """
    root = Path(root)
    manifest = read_manifest(root)
    figures = root / FIGURES
    statistics = statistics_of(root)
    clips = statistics.clip_table()

    with replacing(figures / "clips.csv") as temporary:
        clips.to_csv(temporary, index=False, lineterminator="\n")
    draw_statistics(statistics, figures / "statistics.png")
    draw_contact_sheet(root, statistics, figures / "contact_sheet.jpg")
    draw_flight(root, statistics, figures / "flight.gif")
    metadata = croissant_of(root, manifest, WHAT_IT_IS.replace("*", ""), figures / "clips.csv")
    _write(root / CROISSANT, json.dumps(metadata, indent=1) + "\n")
    # Pictures of task=portraits may lie here as well.
    pictures = [path.name for path in figures.iterdir() if path.is_file() and path.name != SUMS]
    _write(root / CARD, card_text(root.name, manifest, statistics, clips, pictures))
    files = [root / CARD, root / CROISSANT, *(figures / name for name in sorted(pictures))]
    sums = "".join(f"{sha256_of(path)}  {path.relative_to(root).as_posix()}\n" for path in files)
    _write(root / CARD_SUMS, sums)


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
