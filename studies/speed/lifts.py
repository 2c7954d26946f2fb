"""The cost of the lifts side by side, at the paper's size: one frame, random weights.

    python -m studies.speed.lifts [--threads N] [--rounds N]

Prints for every lift the milliseconds of a forward, of a forward with its backward, and of the
pyramid below it, which computes only what the lift reads; then its parameters. The camera is the
dataset's: level flight, 90 degrees. The lifts take turns, so that whatever else the machine does
meets all of them.
"""

import argparse
from collections.abc import Callable

import torch
from hydra.utils import instantiate
from torch import Tensor, nn

from src.geometry import VoxelGrid, front_mount, pinhole
from src.models.backbone import STRIDES
from src.models.neck import FPN
from src.models.references import PillarReferences, References
from src.settings import GROUPS
from studies.settings import composed, run
from studies.speed.timing import print_costs

LIFTS = sorted(path.stem for path in (GROUPS / "model" / "lift").glob("*.yaml"))
# The feature maps of a ResNet-50.
CHANNELS = (256, 512, 1024, 2048)


class Scene:
    """The inputs of a lift at the paper's size, and the lifts."""

    def __init__(self) -> None:
        named = {name: composed(["scale=paper", f"model/lift={name}"]) for name in LIFTS}
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

        # A pyramid computes only the levels that its lift reads.
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
    """Returns the references of a level UAV with its camera at its center."""
    pix_from_camera = pinhole(image.width, image.height, torch.pi / 2).float()
    references = PillarReferences(grid, num_heights, "attitude")
    camera = front_mount((0.0, 0.0, 0.0)).float()[None], pix_from_camera[None]
    return references(torch.eye(4)[None], *camera, (image.width, image.height))


def measures(scene: Scene) -> dict[str, Callable[[], object]]:
    """Returns the measures of all lifts by name."""

    def forward(lift: nn.Module) -> Tensor:
        features = [feature.detach().requires_grad_() for feature in scene.features]
        return lift(scene.query, features, scene.references)

    # A forward with its backward needs inputs that want gradients; they are made anew each time.
    todo: dict[str, Callable[[], object]] = {}
    for name, lift in scene.lifts.items():
        neck = scene.necks[name]
        todo[f"{name}, forward"] = lambda lift=lift: torch.no_grad()(forward)(lift)
        todo[f"{name}, forward and backward"] = lambda lift=lift: forward(lift).sum().backward()
        todo[f"{name}, its pyramid"] = lambda neck=neck: torch.no_grad()(neck)(scene.maps)
    return todo


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    scene = Scene()
    notes = []
    for name, lift in scene.lifts.items():
        count = sum(parameter.numel() for parameter in lift.parameters())
        notes.append(f"{name}: {count:,} parameters")
    print_costs(scene.title, measures(scene), arguments.rounds, notes)


if __name__ == "__main__":
    run(main)
