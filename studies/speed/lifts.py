"""The cost of the lifts side by side, at the paper's size: one frame, random weights.

    python -m studies.speed.lifts [--threads N] [--rounds N]

Prints for every lift the milliseconds of a forward, of a forward with its backward, and of the
pyramid below it, which computes only what the lift reads; then its parameters. The camera is the
dataset's: level flight, 90 degrees. The lifts take turns, so that whatever else the machine does
meets all of them.
"""

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


def references_of(grid: VoxelGrid, num_heights: int, image) -> References:
    """Returns the references of a level UAV with its camera at its center."""
    pix_from_camera = pinhole(image.width, image.height, torch.pi / 2).float()
    references = PillarReferences(grid, num_heights, "attitude")
    camera = front_mount((0.0, 0.0, 0.0)).float()[None], pix_from_camera[None]
    return references(torch.eye(4)[None], *camera, (image.width, image.height))


def measures() -> tuple[str, dict[str, Callable[[], object]], list[str]]:
    """Returns what is measured, the measures of all lifts by name, and the size of each lift."""
    named = {name: composed(["scale=paper", f"model/lift={name}"]) for name in LIFTS}
    cfg = named[LIFTS[0]]
    dim, heights, image = cfg.size.dim, cfg.size.heights, cfg.sim.image

    torch.manual_seed(0)
    references = references_of(VoxelGrid(**cfg.grid), heights, image)
    query = torch.randn(1, references.valid.shape[1], dim)
    levels = zip(CHANNELS, STRIDES)
    maps = [torch.randn(1, c, image.height // s, image.width // s) for c, s in levels]
    pyramid = FPN(CHANNELS, dim)(maps)

    # A forward with its backward needs inputs that want gradients; they are made anew each time.
    def forward(lift: nn.Module) -> Tensor:
        features = [feature.detach().requires_grad_() for feature in pyramid]
        return lift(query, features, references)

    todo: dict[str, Callable[[], object]] = {}
    notes = []
    for name, own in named.items():
        lift = instantiate(own.model.encoder.lift)(dim=dim, num_heights=heights)
        # A pyramid computes only the levels that its lift reads.
        neck = FPN(CHANNELS, dim, getattr(lift, "reads_strides", STRIDES))
        todo[f"{name}, forward"] = lambda lift=lift: torch.no_grad()(forward)(lift)
        todo[f"{name}, forward and backward"] = lambda lift=lift: forward(lift).sum().backward()
        todo[f"{name}, its pyramid"] = lambda neck=neck: torch.no_grad()(neck)(maps)
        notes.append(f"{name}: {sum(each.numel() for each in lift.parameters()):,} parameters")

    pillars = f"{query.shape[1]} pillars of {heights} heights"
    return f"{dim} channels, {pillars}, image {image.width}x{image.height}", todo, notes


def main(*, threads: int = 1, rounds: int = 7) -> None:
    torch.set_num_threads(threads)
    title, todo, notes = measures()
    print_costs(title, todo, rounds, notes)


if __name__ == "__main__":
    run(main)
