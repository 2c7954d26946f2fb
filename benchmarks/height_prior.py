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
from jaxtyping import UInt8

from benchmarks.settings import composed_with_data, run
from benchmarks.tables import print_table
from src.data.datamodule import SkyShieldData
from src.ontology import NUM_CLASSES
from src.provenance import git_commit

# Each voxel counts as if it had seen this many of the overall mixture of classes.
PSEUDO_COUNT = 3.0


class Frequencies:
    """Class counts of every voxel of a grid of some height."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.counts = np.zeros((*shape, NUM_CLASSES))

    def add(self, labels: UInt8[np.ndarray, "X Y Z"], layer: int) -> None:
        """Counts labels whose lowest layer is the given one."""
        part = self.counts[:, :, layer : layer + labels.shape[2]]
        for class_id in range(NUM_CLASSES):
            part[..., class_id] += labels == class_id

    def nats(self, frames: Sequence[tuple[UInt8[np.ndarray, "X Y Z"], int]]) -> float:
        """Returns the mean cross-entropy of labelled voxels of frames with their lowest layers."""
        total = self.counts.sum(axis=(0, 1, 2))
        counts = self.counts + PSEUDO_COUNT * total / total.sum()
        log_share = np.log(counts / counts.sum(axis=-1, keepdims=True))

        labelled = []
        for labels, layer in frames:
            part = log_share[:, :, layer : layer + labels.shape[2]]
            index = np.minimum(labels, NUM_CLASSES - 1)[..., None].astype(int)
            labelled.append(np.take_along_axis(part, index, axis=-1)[labels < NUM_CLASSES])
        return -float(np.concatenate(labelled).mean())


def frames_of(
    data: SkyShieldData, part: str, every: int
) -> Iterator[tuple[UInt8[np.ndarray, "X Y Z"], float]]:
    """Yields labels and height in metres of every n-th frame."""
    for clip_id, frame in data.split[part][::every]:
        clip = data.clips[clip_id]
        yield clip.semantics(frame), float(clip.world_from_body[frame][2, 3])


def measure(data: SkyShieldData, every: int) -> Iterator[tuple[str, float]]:
    """Yields the cross-entropy in nats without and with the height."""
    known = {part: list(frames_of(data, part, every)) for part in ("train", "val")}
    voxel_m, (rows, columns, layers) = data.grid.voxel_m, data.grid.shape
    lifts = [round(height_m / voxel_m) for frames in known.values() for _, height_m in frames]
    lowest, highest = min(lifts), max(lifts)

    for name, moves in {"without the height": 0, "with the height": 1}.items():
        placed = {
            part: [(labels, moves * (round(h_m / voxel_m) - lowest)) for labels, h_m in frames]
            for part, frames in known.items()
        }
        frequencies = Frequencies((rows, columns, layers + moves * (highest - lowest)))
        # Only training frames are counted: the validation labels are what is to be predicted.
        for labels, layer in placed["train"]:
            frequencies.add(labels, layer)
        yield name, frequencies.nats(placed["val"])


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
