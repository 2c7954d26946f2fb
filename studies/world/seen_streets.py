"""How much of what the test frames show had been in view of a training frame, of any flight.

    python -m studies.world.seen_streets [--out FILE] [OVERRIDE...]

Flights of one town share its streets: a town is drawn once for a name and a seed, or, with
``sim.town_seeds``, once for each of its drawings. Counted are the static occupied voxels that the
camera sees in the test frames, within 25 m: the share with a voxel beside them, a voxel's side away
at most, that the camera saw occupied in a training frame of the same drawing. Prints a row for each
town and part of the split, and writes them to ``--out``.
"""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from jaxtyping import Int64

from src.data.clip import Clip
from src.geometry import transform, world_from_occ
from src.ontology import CAR, FREE, LARGE_VEHICLE, UNKNOWN, VRU
from src.results.files import write_table
from src.terminal import tracked
from studies.settings import composed_with_data, run
from studies.tables import print_table

NEAR_M = 25.0
LEFT_OUT = (CAR, LARGE_VEHICLE, VRU, FREE, UNKNOWN)
# The cell itself and the six beside it.
BESIDE = np.concatenate(
    [np.zeros((1, 3), np.int64), np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)]
)
BITS = 20

Cells = Int64[np.ndarray, "n 3"]


def main(*overrides: str, out: Path | None = None) -> None:
    cfg, data = composed_with_data(overrides)
    trained = _by_clip(data.split["train"])
    drawings = cfg.sim.town_seeds
    of_streets: dict[tuple, list[Cells]] = defaultdict(list)
    for clip, frames in tracked(trained.items(), "reading what training sees"):
        keys = _keys(cells_in_view(data.clips[clip], frames))
        of_streets[streets_of(clip, drawings)].append(keys)
    seen = {streets: np.unique(np.concatenate(keys)) for streets, keys in of_streets.items()}

    counts: dict[tuple[str, str], np.ndarray] = defaultdict(lambda: np.zeros(2, np.int64))
    for clip, frames in tracked(_by_clip(data.split["test"]).items(), "comparing"):
        cells = cells_in_view(data.clips[clip], frames, NEAR_M)
        streets = town, _ = streets_of(clip, drawings)
        found = in_any(cells, seen.get(streets, np.zeros(0, np.int64)))
        part = "unseen flights" if clip in cfg.data.test_clips else "last seconds"
        for place in (town, "all"):
            counts[part, place] += len(cells), int(found.sum())

    rows = [
        (part, town, int(n), round(m / n, 4)) for (part, town), (n, m) in sorted(counts.items())
    ]
    columns = ("part", "town", "voxels", "share seen in training")
    print_table(data.root.name, columns, [tuple(map(str, row)) for row in rows])
    if out is not None:
        write_table(pd.DataFrame(rows, columns=columns), out)


def cells_in_view(clip: Clip, frames: Iterable[int], within_m: float = np.inf) -> Cells:
    """Returns the cells of the world, as large as a voxel, of the static occupied voxels that the
    camera sees in some frames, one of each frame and voxel."""
    centers_m = clip.meta.grid.centers(dtype=torch.float64).reshape(-1, 3)
    near = centers_m.norm(dim=1) <= within_m
    cells = []
    for frame in frames:
        labels = torch.from_numpy(clip.semantics(frame)).reshape(-1)
        chosen = near & torch.from_numpy(clip.visible(frame)).reshape(-1)
        for left_out in LEFT_OUT:
            chosen &= labels != left_out
        places_m = transform(world_from_occ(clip.world_from_body[frame]), centers_m[chosen])
        cells.append(torch.floor(places_m / clip.meta.grid.voxel_m).long().numpy())
    return np.concatenate(cells)


def in_any(cells: Cells, keys: Int64[np.ndarray, "m"]) -> np.ndarray:
    """Tells of each cell whether it, or one beside it, is among those of the keys."""
    return np.any([np.isin(_keys(cells + offset), keys) for offset in BESIDE], axis=0)


def _keys(cells: Cells) -> Int64[np.ndarray, "n"]:
    """Returns a number for each cell."""
    x, y, z = (cells + 2 ** (BITS - 1)).T
    return (x << 2 * BITS) | (y << BITS) | z


def _by_clip(samples: Iterable[tuple[str, int]]) -> dict[str, list[int]]:
    frames: dict[str, list[int]] = defaultdict(list)
    for clip, frame in samples:
        frames[clip].append(frame)
    return frames


def streets_of(clip_id: str, drawings: int) -> tuple[str, int]:
    """Returns the town of a clip and which of its ``drawings`` it flies through (`stage_clip`)."""
    town, _, number = clip_id.partition("/clip")
    return town, int(number) % drawings


if __name__ == "__main__":
    run(main)
