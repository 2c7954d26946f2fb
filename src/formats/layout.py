"""``layout.json``: what files of another tool's format do not say, beside labels that we write."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..data.files import BROKEN
from ..errors import UserError, reason_of, way_out_of
from ..geometry import VoxelGrid
from .label_format import LabelFormat

LAYOUT = "layout.json"
FRAME = "grid and velocities are in the frame occ: x forward, y left, z up, in metres"


def write_layout(
    folder: Path,
    of: LabelFormat,
    grid: VoxelGrid,
    velocity_mps: Mapping[str, Sequence[float]],
    unseen: Sequence[str],
) -> None:
    """Writes the grid, the class of every id, each frame's velocity by ``<scene>/<token>``, and the
    scenes that no training saw."""
    content = {
        "layout": of.name,
        "frame": FRAME,
        "grid": {name: list(value) for name, value in vars(grid).items()},
        "class_map": {str(number): name for name, number in of.ids.items()},
        "velocity_mps": velocity_mps,
        "unseen": list(unseen),
    }
    (folder / LAYOUT).write_text(json.dumps(content, indent=1) + "\n")


def layout_beside(folder: Path, name: str) -> dict:
    """Returns what a folder's own ``layout.json`` says, with ids as numbers; nothing without one.

    Raises `UserError` for one that cannot be read, and for one of another format than ``name``.
    """
    path = folder / LAYOUT
    if not path.is_file():
        return {}

    try:
        content = json.loads(path.read_text())
        content["class_map"] = {int(key): each for key, each in content["class_map"].items()}
        said, _ = content.pop("layout"), VoxelGrid(**content["grid"])
        np.array([*content["velocity_mps"].values()], np.float64).reshape(-1, 3)
    except (*BROKEN, AttributeError) as error:
        way_out = way_out_of(error, "write the folder again", path)
        raise UserError(f"{path}: cannot be read ({reason_of(error)}); {way_out}") from error

    if said != name:
        raise UserError(f"{path}: these are files of {said}; score them with layout={said}")
    return content
