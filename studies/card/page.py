"""The card of a finished dataset: a page for people, figures, a table, and Croissant metadata."""

import json
import shlex
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import StrictUndefined, Template

from src.atomic import replacing
from src.data.actors import MIN_VISIBLE_SHARE
from src.data.clip import CLIP_SECONDS, SUMS, Clip, sha256_of
from src.data.manifest import DatasetSpec, read_manifest
from src.report.animation import draw_clip, liveliest
from src.report.canvas import readable
from studies.card import paper
from studies.card.contact_sheet import draw_contact_sheet
from studies.card.croissant import croissant_of
from studies.card.figure import draw_statistics, percent, visible_totals
from studies.card.statistics import Statistics, statistics_of

TEMPLATE = Path(__file__).with_name("card.md.j2")
CARD, FIGURES, CROISSANT = "README.md", "card", "croissant.json"
CARD_SUMS = f"{FIGURES}/{SUMS}"

WHAT_IT_IS = (
    "A semantic occupancy dataset for low-altitude UAV flight: front images of flights of 12 s "
    "through procedural towns, the attitude and place of every frame, and the occupied, free and "
    "unknown voxels of the space ahead. It regenerates itself from a seed, after the paper "
    "*SkyShield: Occupancy as a Safety Interface for Low-Altitude UAV Autonomy*."
)

# Made with the simulator by another task; shown where they lie beside the card's own.
PICTURES = {
    "weathers.jpg": "One frame under every weather",
    "pipeline.jpg": "How a frame is annotated, from its real intermediate results",
}


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
    _write(root / CARD, f"{_card(root.name, manifest, statistics, clips, pictures)}\n")
    files = [root / CARD, root / CROISSANT, *(figures / name for name in sorted(pictures))]
    sums = "".join(f"{sha256_of(path)}  {path.relative_to(root).as_posix()}\n" for path in files)
    _write(root / CARD_SUMS, sums)


def draw_flight(root: Path, statistics: Statistics, path: str | Path) -> None:
    """Writes a GIF of the `liveliest` clip of the first weather, 4 s around its middle.

    Raises `UserError` for a clip that cannot be read and a path that cannot be written.
    """
    frames, first_weather = statistics.frames, statistics.clips["weather"].iloc[0]
    clip = Clip(root / liveliest(frames[frames["weather"] == first_weather]))
    draw_clip(clip, range(len(clip)), None, path)


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _card(
    name: str, manifest: Mapping, statistics: Statistics, clips: pd.DataFrame, pictures: list[str]
) -> str:
    """Returns the card of a dataset as Markdown: its numbers, and the paper's beside them.

    ``name`` is its folder's, ``clips`` its `Statistics.clip_table`, ``pictures`` the files in
    ``card/``: those of `PICTURES` among them are shown.
    """
    text = TEMPLATE.read_text(encoding="utf-8")
    return Template(text, undefined=StrictUndefined, trim_blocks=True).render(
        name=name,
        what_it_is=WHAT_IT_IS,
        extra={file: text for file, text in PICTURES.items() if file in pictures},
        overrides=map(shlex.quote, overrides_of(manifest)),
        manifest=manifest,
        digest=DatasetSpec(manifest["scale"], manifest["sim"], manifest["generator"]).digest,
        statistics=statistics,
        totals=visible_totals(statistics),
        clips=clips,
        paper=paper,
        clip_seconds=CLIP_SECONDS,
        min_visible_share=MIN_VISIBLE_SHARE,
        **{"readable": readable, "percent": percent, "span": _span, "in_degrees": np.rad2deg},
    )


def _span(form: str, values: pd.Series) -> str:
    """The least and the greatest value, once where they read the same."""
    return " to ".join(dict.fromkeys(map(form.format, (values.min(), values.max()))))


def overrides_of(manifest: Mapping) -> list[str]:
    """The overrides that name this very dataset, whatever the defaults are."""
    sim, held_out = manifest["sim"], manifest["held_out"]
    overrides = ["task=generate", f"scale={manifest['scale']}"]
    for key, value in sim.items():
        # The values of the weathers are files of the configuration, too many for a command line.
        if key != "weather":
            overrides += _assignments(f"sim.{key}", value)
    overrides += [f"data.{part}_clips={_plain(held_out[part])}" for part in ("val", "test")]

    # It shapes no data; but a step that the capture rate does not divide is refused.
    if (0.2 * sim["capture_hz"]) % 1:
        overrides.append(f"data.history_step_s={1 / sim['capture_hz']:g}")
    return overrides


def _assignments(key: str, value: object) -> list[str]:
    """``key=value``, one for each leaf. The grid is set once for data and model."""
    if isinstance(value, Mapping):
        leaves = (_assignments(f"{key}.{name}", leaf) for name, leaf in value.items())
        return list(chain.from_iterable(leaves))
    key = key.replace("sim.grid.", "grid.")
    # These two groups are empty by default, and take what their classes take.
    add = "++" if key.startswith(("sim.flight.", "sim.traffic.")) else ""
    return [f"{add}{key}={_plain(value)}"]


def _plain(value: object) -> str:
    """A value as Hydra's command line reads it."""
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_plain, value))}]"
    return json.dumps(value) if value is None or isinstance(value, bool) else str(value)
