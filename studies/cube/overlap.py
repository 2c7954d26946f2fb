"""How much of what is to be found in a clip's last second was labelled in its training frames.

    python -m studies.cube.overlap [OVERRIDE...]

Of the voxels that are counted in the test frames of clips that are split by time and that are
occupied: the share whose center lies in a voxel that a training frame of the same clip labels
occupied, and with the same class.
"""

from collections import defaultdict

import numpy as np
import torch
from jaxtyping import Float

from src.data.clip import Clip
from src.data.split import TRAIN_UNTIL_S
from src.data.truth import SkyShieldTruth
from src.geometry import inverse, transform, world_from_occ
from src.ontology import FREE
from src.terminal import tracked
from studies.settings import composed_with_data, run
from studies.tables import print_table


def main(*overrides: str) -> None:
    _, data = composed_with_data(overrides)
    truth = SkyShieldTruth(data.root, "test")
    frames = defaultdict(list)
    for clip, frame in truth.samples:
        if clip not in truth.unseen:
            frames[clip].append(frame)

    found = sum(
        overlap(truth.clips[clip], tests) for clip, tests in tracked(frames.items(), "comparing")
    )
    shares = [f"{share:.1%}" for share in found[1:] / found[0]]
    columns = ("clips", "occupied voxels", "occupied in training", "of that class")
    title = f"{data.root.name}, voxels of the last second"
    print_table(title, columns, [(f"{len(frames)}", f"{found[0]:.0f}", *shares)])


def overlap(clip: Clip, tests: list[int]) -> Float[np.ndarray, "3"]:
    """Counts the occupied voxels of some frames, those that a training frame labels occupied, and
    those that one labels with their class."""
    grid = clip.meta.grid
    centers_m = grid.centers(dtype=torch.float64).reshape(-1, 3)
    places_m, classes = [], []
    for frame in tests:
        labels = torch.from_numpy(clip.semantics(frame)).reshape(-1)
        chosen = (labels != FREE) & torch.from_numpy(clip.visible(frame)).reshape(-1)
        places_m.append(transform(world_from_occ(clip.world_from_body[frame]), centers_m[chosen]))
        classes.append(labels[chosen])

    places_m, classes = torch.cat(places_m), torch.cat(classes)
    occupied, alike = torch.zeros(2, len(classes), dtype=torch.bool)
    for frame in range(round(TRAIN_UNTIL_S * clip.meta.capture_hz)):
        in_occ_m = transform(inverse(world_from_occ(clip.world_from_body[frame])), places_m)
        cells, inside = grid.index_of(in_occ_m)
        labels = torch.from_numpy(clip.semantics(frame))[tuple(cells[inside].T)]
        occupied[inside] |= labels != FREE
        alike[inside] |= labels == classes[inside]
    return np.array([len(classes), int(occupied.sum()), int(alike.sum())], dtype=float)


if __name__ == "__main__":
    run(main)
