"""The cost of the cross-attention at the paper's size, beside its usual form in plain PyTorch.

    python -m studies.speed.attention DATASET [--threads 1]

D=256, 10,000 pillars x 8 heights, 8 heads, 2 points, four levels of an 800x448 image, and the
transforms of the first frame of any finished dataset. The usual form is the multi-scale deformable
attention of the published codebases without their compiled operator: `grid_sample` level by level,
all samples stored, then weighted and summed; once for every reference, as it is published, and
once for those in view alone, as its callers gather them. Prints median milliseconds, ratios and
the memory that each takes; asserts nothing.
"""

from collections.abc import Callable
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from src.data.clip import Clip
from src.data.manifest import read_manifest
from src.geometry import VoxelGrid, occ_from_body
from src.models.attention import DeformableCrossAttention
from src.models.backbone import STRIDES
from src.models.references import PillarReferences, References
from studies.settings import device, run
from studies.speed.timing import print_costs

ROUNDS = 5
# The paper's size, apart from heights, heads and points, which are our choice.
DIM, HEIGHTS, HEADS, POINTS = 256, 8, 8, 2
SIZE_PIX = (800, 448)


def usual_form(
    attention: DeformableCrossAttention,
    query: Tensor,
    features: list[Tensor],
    references: References,
    in_view: bool,
) -> Tensor:
    """Computes the numbers of one frame from `grid_sample` by level."""
    # References are pairs of a pillar and a height: those in view, or all.
    wanted = references.valid[0] if in_view else torch.ones_like(references.valid[0])
    pillar, height = wanted.nonzero(as_tuple=True)
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
    valid = references.valid[0, pillar, height]
    by_height = query.new_zeros(*references.valid.shape[1:], DIM)
    by_height = by_height.index_put((pillar, height), total.flatten(0, 1).T * valid[:, None])
    update = by_height.flatten(1) @ attention.output.flatten(0, 1)
    return (update / references.valid[0].sum(dim=-1, keepdim=True).clamp(min=1))[None]


def scene(dataset: Path) -> tuple[Tensor, list[Tensor], References]:
    """Returns query, feature maps and the references of a real transform, in the camera's field
    of view."""
    clip = Clip(dataset / next(iter(read_manifest(dataset)["clips"])))
    scale = SIZE_PIX[0] / clip.meta.width
    pix_from_camera = clip.meta.pix_from_camera.float() * torch.tensor([[scale], [scale], [1.0]])
    # The optical axis stays in the middle of an image with another ratio of its sides.
    pix_from_camera[1, 2] = SIZE_PIX[1] / 2
    transforms = occ_from_body(clip.world_from_body[:1]), clip.meta.body_from_camera[None]
    camera = [matrix.float().to(device()) for matrix in (*transforms, pix_from_camera[None])]
    references = PillarReferences(VoxelGrid(), HEIGHTS, "attitude").to(device())(*camera, SIZE_PIX)

    generator = torch.Generator().manual_seed(0)
    width, height = SIZE_PIX
    features = [torch.randn(1, DIM, height // s, width // s, generator=generator) for s in STRIDES]
    # The network's convolutions keep the channels last, so that values need no copy.
    features = [map_.contiguous(memory_format=torch.channels_last) for map_ in features]
    features = [map_.to(device()).requires_grad_() for map_ in features]
    query = torch.randn(1, references.valid.shape[1], DIM, generator=generator)
    return query.to(device()).requires_grad_(), features, references


def main(dataset: Path, *, threads: int = 1) -> None:
    torch.set_num_threads(threads)
    query, features, references = scene(dataset)
    torch.manual_seed(0)
    attention = DeformableCrossAttention(DIM, HEIGHTS, HEADS, POINTS).to(device())
    # Fresh offsets are zero, so all points of a head would fall on one place.
    torch.nn.init.normal_(attention.sampling.weight, std=0.02)

    inputs = attention, query, features, references
    ways: dict[str, Callable[[], Tensor]] = {
        "usual form, every reference": lambda: usual_form(*inputs, in_view=False),
        "usual form, in view alone": lambda: usual_form(*inputs, in_view=True),
        "ours": lambda: attention(query, features, references),
    }
    forward = {name: torch.no_grad()(way) for name, way in ways.items()}
    backward = {name: (lambda way=way: way().sum().backward()) for name, way in ways.items()}

    outputs = [way() for way in forward.values()]
    apart = max((output - outputs[-1]).abs().max().item() for output in outputs)
    notes = (
        f"{references.valid.float().mean():.0%} of the references are in view",
        f"outputs differ by {apart:.1e} at most, of {outputs[-1].abs().max():.1f}",
    )
    print_costs("forward alone", forward, ROUNDS)
    print_costs("forward and backward", backward, ROUNDS, notes)


if __name__ == "__main__":
    run(main)
