"""What the lifts cost side by side, at the paper's size: one frame, random weights.

    python -m benchmarks.lifts [--threads N] [--rounds N]

Prints for every lift the median milliseconds of a forward and of a forward with its backward, its
parameters, and the milliseconds that the pyramid below it takes, which computes only what the lift
reads. The camera is the data set's: level flight, 90 degrees. The lifts take turns, so that
whatever else the machine does meets all of them.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from rich.console import Console
from rich.table import Table
from torch import Tensor, nn

from src.failures import told_in_one_line
from src.geometry import VoxelGrid, front_mount, pinhole
from src.models.backbone import STRIDES
from src.models.neck import FPN
from src.models.references import PillarReferences, References
from src.provenance import machine
from src.settings import GROUPS

LIFTS = sorted(path.stem for path in (GROUPS / "model" / "lift").glob("*.yaml"))
CHANNELS = (256, 512, 1024, 2048)
"""Of a ResNet-50."""


class Scene:
    """The inputs of a lift at the paper's size, and the lifts."""

    def __init__(self) -> None:
        with initialize_config_dir(str(GROUPS.resolve()), version_base="1.3"):
            named = {
                name: compose("config", ["scale=paper", f"model/lift={name}"]) for name in LIFTS
            }
        cfg = named[LIFTS[0]]
        torch.manual_seed(0)
        size = {"dim": cfg.size.dim, "num_heights": cfg.size.heights}
        self.lifts = {name: instantiate(c.model.encoder.lift)(**size) for name, c in named.items()}
        image = cfg.sim.image
        self.references = references_of(VoxelGrid(**cfg.grid), cfg.size.heights, image)
        self.query = torch.randn(1, self.references.valid.shape[1], cfg.size.dim)
        self.maps = [
            torch.randn(1, c, image.height // s, image.width // s)
            for c, s in zip(CHANNELS, STRIDES)
        ]
        self.necks = {
            name: FPN(CHANNELS, cfg.size.dim, getattr(lift, "reads_strides", STRIDES))
            for name, lift in self.lifts.items()
        }
        self.features = FPN(CHANNELS, cfg.size.dim)(self.maps)
        self.title = (
            f"{cfg.size.dim} channels, {self.query.shape[1]} pillars of {cfg.size.heights} "
            f"heights, image {image.width}x{image.height}"
        )


def references_of(grid: VoxelGrid, num_heights: int, image) -> References:
    """Those of a level UAV with its camera at its centre."""
    pix_from_camera = pinhole(image.width, image.height, torch.pi / 2).float()
    references = PillarReferences(grid, num_heights, "attitude")
    return references(
        torch.eye(4)[None],
        front_mount((0.0, 0.0, 0.0)).float()[None],
        pix_from_camera[None],
        (image.width, image.height),
    )


def measures(scene: Scene) -> dict[tuple[str, str], Callable[[], object]]:
    """What is timed, by lift and by column."""

    def forward(lift: nn.Module) -> Tensor:
        features = [feature.detach().requires_grad_() for feature in scene.features]
        return lift(scene.query, features, scene.references)

    todo: dict[tuple[str, str], Callable[[], object]] = {}
    for name, lift in scene.lifts.items():
        neck = scene.necks[name]
        todo[name, "forward"] = lambda lift=lift: torch.no_grad()(forward)(lift)
        todo[name, "and backward"] = lambda lift=lift: forward(lift).sum().backward()
        todo[name, "pyramid"] = lambda neck=neck: torch.no_grad()(neck)(scene.maps)
    return todo


def timed(todo: dict[tuple[str, str], Callable[[], object]], rounds: int) -> dict:
    """Median milliseconds of each."""
    seconds = {key: [] for key in todo}
    for at in range(rounds + 1):  # the first takes memory
        for key, measure in todo.items():
            start_s = time.perf_counter()
            measure()
            if at:
                seconds[key].append(time.perf_counter() - start_s)
    return {key: 1e3 * statistics.median(times) for key, times in seconds.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    scene = Scene()
    spent_ms = timed(measures(scene), arguments.rounds)
    table = Table(title=f"{scene.title}; {machine()}, {arguments.threads} threads")
    columns = ("forward", "and backward", "pyramid")
    for name in ("lift", *(f"{column}, ms" for column in columns), "parameters"):
        table.add_column(name, justify="left" if name == "lift" else "right")
    for name, lift in scene.lifts.items():
        count = sum(p.numel() for p in lift.parameters())
        table.add_row(name, *(f"{spent_ms[name, c]:.0f}" for c in columns), f"{count:,}")
    Console(width=100).print(table)


if __name__ == "__main__":
    with told_in_one_line():
        main()
