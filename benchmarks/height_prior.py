"""How much of the labels follows from the UAV's height alone, without any image.

    python -m benchmarks.height_prior scale=ladder [--every 5]

Two tables of class frequencies are counted over the training frames: one for each voxel of the
grid, which moves with the UAV, and one for each voxel of a grid that is moved up and down, in whole
voxels, so that it stands on the world's ground plane. Prints the cross-entropy of the validation
labels under both, in nats a voxel: what a model can know that has learnt nothing but where things
are, without and with the height. Takes the overrides of run.py and needs the data set to be there.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir
from jaxtyping import UInt8
from rich.console import Console

from src.data.datamodule import SkyShieldData
from src.failures import quiet_libraries, told_in_one_line
from src.ontology import NUM_CLASSES
from src.provenance import git_commit
from src.tasks.dataset import data_of, finished_dataset

PSEUDO_COUNT = 3.0
"""Voxels that each voxel is taken to have seen of the overall mixture of classes."""


class Frequencies:
    """Class counts of every voxel of a grid of some height."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.counts = np.zeros((*shape, NUM_CLASSES))

    def add(self, labels: UInt8[np.ndarray, "X Y Z"], layer: int) -> None:
        """Count labels whose lowest layer is the given one."""
        part = self.counts[:, :, layer : layer + labels.shape[2]]
        for class_id in range(NUM_CLASSES):
            part[..., class_id] += labels == class_id

    def nats(self, frames: Sequence[tuple[UInt8[np.ndarray, "X Y Z"], int]]) -> float:
        """Mean cross-entropy of the labelled voxels of frames with their lowest layers."""
        total = self.counts.sum(axis=(0, 1, 2))
        counts = self.counts + PSEUDO_COUNT * total / total.sum()
        log_share = np.log(counts / counts.sum(axis=-1, keepdims=True))
        found = [
            np.take_along_axis(
                log_share[:, :, layer : layer + labels.shape[2]],
                np.minimum(labels, NUM_CLASSES - 1)[..., None].astype(int),
                axis=-1,
            )[labels < NUM_CLASSES]
            for labels, layer in frames
        ]
        return -float(np.concatenate(found).mean())


def frames_of(
    data: SkyShieldData, part: str, every: int
) -> Iterator[tuple[UInt8[np.ndarray, "X Y Z"], float]]:
    """Labels and height in metres of every n-th frame."""
    for clip_id, frame in data.split[part][::every]:
        clip = data.clips[clip_id]
        yield clip.semantics(frame), float(clip.world_from_body[frame][2, 3])


def measure(data: SkyShieldData, every: int) -> Iterator[tuple[str, float]]:
    """Cross-entropy in nats without and with the height."""
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
        for labels, layer in placed["train"]:
            frequencies.add(labels, layer)
        yield name, frequencies.nats(placed["val"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("overrides", nargs="+")
    parser.add_argument("--every", type=int, default=5, help="take every n-th frame")
    options = parser.parse_args()
    conf = Path(__file__).parent.parent / "conf"
    with initialize_config_dir(str(conf.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=options.overrides)
    data = data_of(cfg, finished_dataset(cfg))
    console = Console(highlight=False, soft_wrap=True)
    for name, nats in measure(data, options.every):
        console.print(f"{name}: {nats:.3f} nats a voxel")
    taken = f"every {options.every}th frame of the training and the validation split"
    console.print(f"{data.root.name}, {taken}, commit {git_commit()}")


if __name__ == "__main__":
    quiet_libraries()
    with told_in_one_line():
        main()
