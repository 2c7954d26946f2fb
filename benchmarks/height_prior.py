"""The share of the labels that follows from the UAV's height alone, without any image.

    python -m benchmarks.height_prior scale=ladder [--every 5]

Two tables of class frequencies are counted over the training frames: one for each voxel of the
grid, which moves with the UAV, and one for each voxel of a grid that is moved up and down, in whole
voxels, so that it stands on the world's ground plane. Prints the cross-entropy of the validation
labels under both, in nats a voxel: a model that has learnt nothing but where things are can know
this much, without and with the height. Takes the overrides of run.py and needs a finished dataset.
"""

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import UInt8

from benchmarks.settings import composed_with_data, run
from benchmarks.tables import print_table
from src.data.datamodule import SkyShieldData
from src.models.prior import VoxelPrior
from src.ontology import NUM_CLASSES
from src.provenance import git_commit

# Each voxel counts as if it had seen this many of the overall mixture of classes.
PSEUDO_COUNT = 3.0

# Labels, and the layer at which their lowest voxels lie of a grid that moves up and down.
Frame = tuple[UInt8[np.ndarray, "X Y Z"], int]


def nats(prior: VoxelPrior, frames: Sequence[Frame]) -> float:
    """Returns the mean cross-entropy of labelled voxels of frames under the prior's counts."""
    counts = prior.counts.movedim(0, -1).numpy()
    total = counts.sum(axis=(0, 1, 2))
    counts = counts + PSEUDO_COUNT * total / total.sum()
    log_share = np.log(counts / counts.sum(axis=-1, keepdims=True))

    labelled = []
    for labels, layer in frames:
        start = layer - prior.layers[0]
        part = log_share[:, :, start : start + labels.shape[2]]
        index = np.minimum(labels, NUM_CLASSES - 1)[..., None].astype(int)
        labelled.append(np.take_along_axis(part, index, axis=-1)[labels < NUM_CLASSES])
    return -float(np.concatenate(labelled).mean())


def measure(data: SkyShieldData, every: int) -> Iterator[tuple[str, float]]:
    """Yields the cross-entropy in nats without and with the height, of every n-th frame."""
    known: dict[str, list[Frame]] = {
        part: [
            (data.clips[clip].semantics(frame), data.layer(clip, frame))
            for clip, frame in data.split[part][::every]
        ]
        for part in ("train", "val")
    }
    layers = [layer for frames in known.values() for _, layer in frames]

    for name, moves in {"without the height": 0, "with the height": 1}.items():
        prior = VoxelPrior(data.grid.shape, (moves * min(layers), moves * max(layers)))
        # Only training frames are counted: the validation labels are what is to be predicted.
        for labels, layer in known["train"]:
            prior.count(torch.from_numpy(labels), moves * layer)
        yield name, nats(prior, [(labels, moves * layer) for labels, layer in known["val"]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("overrides", nargs="+")
    parser.add_argument("--every", type=int, default=5, help="take every n-th frame")
    options = parser.parse_args()
    _, data = composed_with_data(options.overrides)
    rows = [(name, f"{nats:.3f}") for name, nats in measure(data, options.every)]

    taken = f"every {options.every}th frame of the training and the validation split"
    notes = [f"{taken}, commit {git_commit()}"]
    print_table(data.root.name, ("labels known", "nats a voxel"), rows, notes)


if __name__ == "__main__":
    run(main)
