"""The words of a dataset's card, in Markdown."""

import shlex
from collections.abc import Collection, Mapping

import pandas as pd

from ..data.manifest import DatasetSpec
from ..data.statistics import MIN_VISIBLE_SHARE, Statistics
from .card_tables import (
    actor_table,
    benchmark_table,
    class_table,
    clip_rows,
    flight_table,
    settings_table,
    split_table,
)
from .command import overrides_of

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

FILES = """\
| file | content |
| --- | --- |
| `manifest.json` | settings, package versions, split, the SHA-256 of every file |
| `croissant.json` | Croissant 1.0 metadata: `mlcroissant` loads the tables with it |
| `<town>/<clip>/clip.json` | town, weather, seed, camera matrices, image size, voxel grid |
| `<town>/<clip>/frames.csv` | per frame: time, pose (position and quaternion), velocity, body \
rates, attitude, height above the ground |
| `<town>/<clip>/actors.csv` | per frame and moving actor: type, class, place, velocity, size, \
yaw, pixels in the front image |
| `<town>/<clip>/rgb.zip` | JPEG images `000000.jpg` ... |
| `<town>/<clip>/occupancy.npz` | `semantics_000000` uint8 [X, Y, Z] (255 is unknown), \
`visible_000000` bool [X, Y, Z] ... |
| `<town>/<clip>/aux.npz` | only with `sim.save_aux=true`: depth, class and instance images |
| `<town>/<clip>/SHA256SUMS` | of the clip's files |
| `card/` | the figures of this page, and `clips.csv` |

Metres, seconds, radians; x forward, y left, z up. `docs/conventions.md` of the project defines \
every frame and unit, and its tests execute that page."""

LIMITS = """\
- It is synthetic: simple solids with procedural textures, and weather that is drawn into the \
image. How a model trained on it does on real flights has not been measured.
- Labels come from annotation signals (depth, instances, two LiDARs), as in the paper, and not \
from the exact geometry. What no signal reached, and all outside the front image, is unknown.
- The split separates frames, not scenes: the last training frame of a clip and its first \
validation frame are one capture step apart. Only the held-out clips are unseen flights.
- Whether an actor counts as visible depends on the image size where the least share of the \
image's pixels is less than one pixel.
- The same settings give the same bytes on one kind of machine; other processors and package \
versions may round differently."""

SPLIT_RULE = (
    "Of a clip, [0, 10) s are for training, [10, 11) s for validation and [11, 12) s for test. "
    "Clips that are held out belong whole to their part."
)
CLASS_RULE = (
    "A voxel is in the image if its center projects into it, and labelled if an annotation signal "
    "also reached it; all others are unknown. The paper does not say of which voxels its shares "
    "are."
)
DIVERSITY_RULE = (
    "The other rows are the paper's Table 1. The diversity of this dataset is its number of "
    "weathers, as the 10 of the paper's is."
)


def card_text(
    name: str,
    manifest: Mapping,
    statistics: Statistics,
    clips: pd.DataFrame,
    pictures: Collection[str],
) -> str:
    """The card of a dataset as Markdown.

    ``name`` is its folder's, ``clips`` its `Statistics.clip_table`, ``pictures`` the files in
    ``card/``: those of `PICTURES` among them are shown.
    """
    extra = [f"![{PICTURES[file]}](card/{file})" for file in PICTURES if file in pictures]
    flight = "![A flight: the front image and its labels](card/flight.gif)"
    sheet = "![Every town under every weather that it was flown in](card/contact_sheet.jpg)"
    figure = "![Town by weather, heights, voxels, actors](card/statistics.png)"
    actors = f"Visible is {MIN_VISIBLE_SHARE:.3%} of the image or more."

    sections = [f"# SkyShield dataset `{name}`", WHAT_IT_IS, flight, sheet, *extra]
    sections += ["## Make it again", _regeneration(manifest, statistics)]
    sections += ["## Statistics", figure, settings_table(manifest["sim"], statistics)]
    sections += [flight_table(statistics), actor_table(statistics), actors]
    sections += ["## Voxels of each class", CLASS_RULE, class_table(statistics)]
    sections += ["## Split", SPLIT_RULE, split_table(statistics)]
    sections += ["## Beside other datasets", benchmark_table(statistics), DIVERSITY_RULE]
    sections += ["## Clips", _clips(clips), "## Files", FILES, "## Known limits", LIMITS]
    licence = "MIT, data and code alike. Nothing in it shows a real person or place."
    sections += ["## Licence", licence]
    return "\n\n".join(sections) + "\n"


def _regeneration(manifest: Mapping, statistics: Statistics) -> str:
    spec = DatasetSpec(manifest["scale"], manifest["sim"], manifest["generator"])
    overrides = " \\\n    ".join(map(shlex.quote, overrides_of(manifest)))
    size_mb = statistics.clips["bytes"].sum() / 1e6
    packages = ", ".join(f"{name} {version}" for name, version in manifest["packages"].items())
    return f"""\
```
python run.py {overrides}
```

makes these {len(statistics.clips)} clips ({size_mb:,.1f} MB), with `sim.seed=\
{manifest["sim"]["seed"]}` and any number of workers. Their digest is `{spec.digest}`, of all \
settings and of the generator's code (`{manifest["generator"]}`); other settings or other code \
give another folder. `python run.py task=check paths.dataset=<this folder>` verifies every file.

Made with {packages}."""


def _clips(clips: pd.DataFrame) -> str:
    return f"""\
[`card/clips.csv`](card/clips.csv) has every column.

<details>
<summary>{len(clips)} clips: means of height and speed, shares of the labelled voxels</summary>

{clip_rows(clips)}

</details>"""
