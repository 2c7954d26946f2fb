"""The card of a finished dataset: a page for people, figures, a table, and Croissant metadata."""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import StrictUndefined, Template

from src.data.actors import MIN_VISIBLE_SHARE, liveliest
from src.data.clip import CLIP_SECONDS, SUMS, Clip, sha256_of
from src.data.manifest import DatasetSpec, read_manifest
from src.report.animation import draw_flight
from src.report.canvas import readable, write_figure
from src.report.template import write_text
from studies.card import paper
from studies.card.contact_sheet import draw_contact_sheet
from studies.card.croissant import croissant_of
from studies.card.figure import percent, statistics_figure, visible_totals
from studies.card.statistics import statistics_of

TEMPLATE = Path(__file__).with_name("card.md.j2")
CARD, FIGURES, CROISSANT = "README.md", "card", "croissant.json"

WHAT_IT_IS = (
    "A semantic occupancy dataset for low-altitude UAV flight: front images of flights of 12 s "
    "through procedural towns, the attitude and place of every frame, and the occupied, free and "
    "unknown voxels of the space ahead. It regenerates itself from a seed, after the paper "
    "*SkyShield: Occupancy as a Safety Interface for Low-Altitude UAV Autonomy*."
)

OF_A_RECORDING = (
    "A semantic occupancy dataset for low-altitude UAV flight: front images of clips of 12 s, cut "
    "from a recording, the attitude and place of every frame, and the occupied, free and unknown "
    "voxels of the space ahead, labelled by SkyShield."
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
    root, figures = Path(root), Path(root) / FIGURES
    manifest, statistics = read_manifest(root), statistics_of(root)
    clips = statistics.clip_table()

    write_text(figures / "clips.csv", clips.to_csv(index=False, lineterminator="\n"))
    write_figure(statistics_figure(statistics), figures / "statistics.png")
    draw_contact_sheet(root, statistics, figures / "contact_sheet.jpg")
    shown = clips["clip"][clips["weather"] == clips["weather"][0]]
    draw_flight(liveliest([Clip(root / name) for name in shown]), figures / "flight.gif")
    recorded = "layout" in manifest.get("source", {})
    what_it_is = OF_A_RECORDING if recorded else WHAT_IT_IS
    metadata = croissant_of(root, manifest, what_it_is.replace("*", ""), figures / "clips.csv")
    write_text(root / CROISSANT, json.dumps(metadata, indent=1) + "\n")

    # Pictures of task=portraits may lie here as well.
    files = [path.name for path in figures.iterdir() if path.is_file()]
    pictures = sorted({*files} - {SUMS})
    text = TEMPLATE.read_text(encoding="utf-8")
    card = Template(text, undefined=StrictUndefined, trim_blocks=True).render(
        name=root.name,
        what_it_is=what_it_is,
        extra={file: text for file, text in PICTURES.items() if file in pictures},
        overrides=map(shlex.quote, overrides_of(manifest)),
        manifest=manifest,
        recorded=recorded,
        digest=DatasetSpec(
            *(manifest[key] for key in ("scale", "sim", "generator")), manifest.get("source")
        ).digest,
        statistics=statistics,
        totals=visible_totals(statistics),
        clips=clips,
        paper=paper,
        clip_seconds=CLIP_SECONDS,
        min_visible_share=MIN_VISIBLE_SHARE,
        **{"readable": readable, "percent": percent, "span": _span, "in_degrees": np.rad2deg},
    )
    write_text(root / CARD, f"{card}\n")
    files = [root / CARD, root / CROISSANT, *(figures / name for name in pictures)]
    sums = "".join(f"{sha256_of(path)}  {path.relative_to(root).as_posix()}\n" for path in files)
    write_text(figures / SUMS, sums)


def _span(form: str, values: pd.Series) -> str:
    """The least and the greatest value, once where they read the same."""
    return " to ".join(dict.fromkeys(map(form.format, (values.min(), values.max()))))


def overrides_of(manifest: Mapping) -> list[str]:
    """The overrides that name this very dataset, whatever the defaults are."""
    sim, held_out, source = manifest["sim"], manifest["held_out"], manifest.get("source", {})
    if "layout" in source:
        sides = [
            each
            for key in ("lower_m", "upper_m", "shape")
            for each in _assignments(f"grid.{key}", sim["grid"][key])
        ]
        return [
            "task=annotate",
            "recording=DIR",
            f"layout={source['layout']['name']}",
            *sides,
        ]
    # The values of the weathers are files of the configuration, too many for a command line.
    settings = {f"sim.{key}": value for key, value in sim.items() if key != "weather"}
    if source:  # flights of task=verge
        for group in ("mission", "planner", "airframe"):
            settings |= {f"{group}.{key}": value for key, value in source[group].items()}
        # Of a file of missions the dataset knows the contents alone.
        given = source["missions"] and "FILE"
        settings |= {"task.missions": given, "task.grid": source["grid"]}
        settings |= {"task.rules": source["rules"]}
        leaves = [each for key, value in settings.items() for each in _assignments(key, value)]
        return ["task=verge", f"scale={manifest['scale'].removesuffix('-verge')}", *leaves]
    settings |= {f"data.{part}_clips": held_out[part] for part in ("val", "test")}
    # It shapes no data; but a step that the capture rate does not divide is refused.
    if (0.2 * sim["capture_hz"]) % 1:
        settings["data.history_step_s"] = f"{1 / sim['capture_hz']:g}"
    leaves = [each for key, value in settings.items() for each in _assignments(key, value)]
    return ["task=generate", f"scale={manifest['scale']}", *leaves]


def _assignments(key: str, value: object) -> list[str]:
    """``key=value``, one for each leaf. The grid is set once for data and model."""
    if isinstance(value, Mapping):
        return [each for name in value for each in _assignments(f"{key}.{name}", value[name])]
    key = key.replace("sim.grid.", "grid.")
    # These two groups are empty by default, and take what their classes take.
    add = "++" if key.startswith(("sim.flight.", "sim.traffic.")) else ""
    # Hydra's command line reads JSON, and needs no quotes around its words.
    plain = json.dumps(value, separators=(",", ":")).replace('"', "")
    return [f"{add}{key}={plain}"]
