"""What the cross-attention costs at the paper's size, beside its usual form in plain PyTorch.

    python -m benchmarks.attention DATASET [--threads 1]

D=256, 10,000 pillars x 8 heights, 8 heads, 2 points, four levels of an 800x448 image, and the
poses of the first frame of any finished data set. The usual form is the multi-scale deformable
attention of the published codebases without their compiled operator: `grid_sample` level by level,
all samples stored, then weighted and summed; once for every reference, as it is published, and
once for those in view alone, as its callers gather them. Prints median milliseconds, ratios and
the memory that each takes; asserts nothing.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import torch
import torch.nn.functional as F
from rich.console import Console
from rich.table import Table
from torch import Tensor

from benchmarks.timing import extra_mib, median_ms
from src.data.clip import Clip
from src.data.manifest import read_manifest
from src.failures import told_in_one_line
from src.geometry import VoxelGrid, occ_from_body
from src.models.attention import DeformableCrossAttention
from src.models.backbone import STRIDES
from src.models.references import PillarReferences, References
from src.provenance import machine

ROUNDS = 5
DIM, HEIGHTS, HEADS, POINTS = 256, 8, 8, 2
SIZE_PIX = (800, 448)


def usual_form(
    attention: DeformableCrossAttention,
    query: Tensor,
    features: list[Tensor],
    references: References,
    in_view: bool,
) -> Tensor:
    """The same numbers from `grid_sample` by level, for one frame."""
    pillars, heights = references.valid.shape[1:]
    if in_view:
        pillar, height = references.valid[0].nonzero(as_tuple=True)
    else:
        pillar, height = (
            x.flatten()
            for x in torch.cartesian_prod(
                torch.arange(pillars, device=query.device),
                torch.arange(heights, device=query.device),
            ).T
        )
    values = [attention.value(feature.permute(0, 2, 3, 1)) for feature in features]
    raw = attention.sampling(query[0, pillar] + attention.height_embedding[height])
    raw = raw.view(-1, 3, HEADS, POINTS, len(STRIDES))
    weight = raw[:, 2].flatten(-2).softmax(dim=-1).view_as(raw[:, 2])
    reference = references.pix[0, pillar, height]
    sampled = []
    for level, value in enumerate(values):
        rows, columns = value.shape[1:3]
        maps = value[0].unflatten(-1, (HEADS, -1)).permute(2, 3, 0, 1)
        place = reference[:, None, None] / STRIDES[level] + raw[:, :2, :, :, level].movedim(1, -1)
        place = 2 * place / place.new_tensor([columns, rows]) - 1
        sampled.append(F.grid_sample(maps, place.transpose(0, 1), align_corners=False))
    # [heads, channels, references, points * levels], as the published code stacks them.
    stacked = torch.stack(sampled, dim=-1).flatten(-2)
    total = (stacked * weight.flatten(-2).transpose(0, 1)[:, None]).sum(dim=-1)
    by_height = query.new_zeros(pillars, heights, DIM)
    valid = references.valid[0, pillar, height]
    found = total.flatten(0, 1).T * valid[:, None]
    by_height = by_height.index_put((pillar, height), found)
    update = by_height.flatten(1) @ attention.output.flatten(0, 1)
    return (update / references.valid[0].sum(dim=-1, keepdim=True).clamp(min=1))[None]


def scene(dataset: Path, device: torch.device) -> tuple[Tensor, list[Tensor], References]:
    """Query, feature maps and the references of a real pose, in the camera's field of view."""
    clip = Clip(dataset / next(iter(read_manifest(dataset)["clips"])))
    scale = SIZE_PIX[0] / clip.meta.width
    pix_from_camera = clip.meta.pix_from_camera.float() * torch.tensor([[scale], [scale], [1.0]])
    pix_from_camera[1, 2] = SIZE_PIX[1] / 2
    references = PillarReferences(VoxelGrid(), HEIGHTS, "attitude").to(device)(
        occ_from_body(clip.world_from_body[:1]).float().to(device),
        clip.meta.body_from_camera.float()[None].to(device),
        pix_from_camera[None].to(device),
        SIZE_PIX,
    )
    generator = torch.Generator().manual_seed(0)
    width, height = SIZE_PIX
    features = [torch.randn(1, DIM, height // s, width // s, generator=generator) for s in STRIDES]
    features = [f.to(device, memory_format=torch.channels_last).requires_grad_() for f in features]
    pillars = references.valid.shape[1]
    query = torch.randn(1, pillars, DIM, generator=generator).to(device).requires_grad_()
    return query, features, references


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    query, features, references = scene(options.dataset, device)
    torch.manual_seed(0)
    attention = DeformableCrossAttention(DIM, HEIGHTS, HEADS, POINTS).to(device)
    torch.nn.init.normal_(attention.sampling.weight, std=0.02)
    ways: dict[str, Callable[[], Tensor]] = {
        "usual form, every reference": lambda: usual_form(
            attention, query, features, references, in_view=False
        ),
        "usual form, in view alone": lambda: usual_form(
            attention, query, features, references, in_view=True
        ),
        "ours": lambda: attention(query, features, references),
    }
    report(ways, f"{references.valid.float().mean():.0%} of the references are in view")


def report(ways: dict[str, Callable[[], Tensor]], of_what: str) -> None:
    """Prints time and memory of all, forward alone and with the backward."""
    console = Console(width=110)
    table = Table(title=f"{machine()}, {torch.get_num_threads()} thread(s); {of_what}")
    for column in ("", "forward ms", "times", "MiB", "and backward ms", "times", "MiB"):
        table.add_column(column, justify="right" if column else "left")
    forward = {name: torch.no_grad()(way) for name, way in ways.items()}
    backward = {name: (lambda way=way: way().sum().backward()) for name, way in ways.items()}
    spent = [median_ms(todo, ROUNDS) for todo in (forward, backward)]
    memory = [
        {name: extra_mib(measure) for name, measure in todo.items()} for todo in (forward, backward)
    ]
    first = next(iter(ways))
    for name in ways:
        cells = [
            cell
            for ms, mib in zip(spent, memory)
            for cell in (f"{ms[name]:.0f}", f"{ms[first] / ms[name]:.1f}", f"{mib[name]:.0f}")
        ]
        table.add_row(name, *cells)
    console.print(table)
    outputs = [way() for way in forward.values()]
    apart = max((output - outputs[-1]).abs().max().item() for output in outputs)
    console.print(f"outputs differ by {apart:.1e} at most, of {outputs[-1].abs().max():.1f}")


if __name__ == "__main__":
    with told_in_one_line():
        main()
