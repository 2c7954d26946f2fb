"""Bilinear sampling of several feature levels, summed over levels and points.

Two ways to the same numbers. `summed_by_bags` is what trains and runs: four corners, levels and
points are all summed in the end, so nothing but the sum is ever stored, as one `embedding_bag` of
contiguous rows; several times faster on a CPU than `grid_sample` by level, and it returns the same
gradient every time on a GPU. `summed_by_grid` is the plain form in operators that every runtime
knows: the reference in tests, and what an exported graph is made of.
"""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, Shaped
from torch import Tensor

# Feature maps, channels last, as rows of a table want them.
Levels = Sequence[Float[Tensor, "b _ _ dim"]]
# One number for each sample. The R places are last, which keeps the arithmetic vectorised.
Samples = Float[Tensor, "heads points levels r"]


def summed_samples(
    levels: Levels, x: Samples, y: Samples, weight: Samples, frame: Int[Tensor, "r"]
) -> Float[Tensor, "r dim"]:
    """``sum over points and levels of weight * level(x, y)`` at R places, head by head.

    ``levels`` are channels-last maps, whose channels are split among the heads. ``x`` and ``y`` are
    pixels of the level, with integers at pixel centers; outside a level is zero. ``frame`` is whose
    map of the B a place is in; where a graph is exported, the places of each frame must be equally
    many and stand together.
    """
    if torch.compiler.is_exporting():
        return summed_by_grid(levels, x, y, weight, frame)
    return summed_by_bags(levels, x, y, weight, frame)


def summed_by_bags(levels, x, y, weight, frame) -> Float[Tensor, "r dim"]:
    """Computes `summed_samples` as one weighted sum of the rows of a table."""
    heads, points = x.shape[:2]
    sizes = [level.shape[1:3] for level in levels]
    # One table of all levels, each with a border of zeros one cell wide.
    rows = torch.cat([F.pad(each, (0, 0, 1, 1, 1, 1)).flatten(1, 2) for each in levels], dim=1)
    batch_size, table_size, dim = rows.shape

    # A table for each head and frame.
    rows = rows.view(-1, heads, dim // heads).transpose(0, 1).flatten(0, 1)
    head = torch.arange(heads, dtype=torch.int32, device=x.device)
    base = (head[:, None, None, None] * batch_size + frame.to(torch.int32)) * table_size

    index, corner_weight = bilinear_corners(x, y, sizes, base)
    weights = (weight[:, None] * corner_weight).to(rows.dtype)
    index, weights = (Transposed.apply(entries.flatten(0, 3)) for entries in (index, weights))

    # What is summed for one place and head now stands together.
    size, bags = 4 * points * len(levels), x.shape[-1] * heads
    offsets = size * torch.arange(bags + 1, dtype=torch.int32, device=x.device)
    return SumOfRows.apply(rows, index.flatten(), weights.flatten(), offsets).view(-1, dim)


def summed_by_grid(levels, x, y, weight, frame) -> Float[Tensor, "r dim"]:
    """Computes `summed_samples` as a `grid_sample` a level."""
    heads, points = x.shape[:2]
    batch_size, dim = len(levels[0]), levels[0].shape[-1]

    def by_frame(entries: Float[Tensor, "heads points r"]) -> Float[Tensor, "maps k points"]:
        return entries.view(heads, points, batch_size, -1).permute(2, 0, 3, 1).flatten(0, 1)

    total = torch.zeros((), dtype=levels[0].dtype, device=x.device)
    for number, level in enumerate(levels):
        height, width = level.shape[1:3]
        maps = level.unflatten(-1, (heads, -1)).permute(0, 3, 4, 1, 2).flatten(0, 1)
        # From pixels, with integers at their centers, to shares from -1 to 1 of the whole map.
        place_x = (2 * by_frame(x[:, :, number]) + 1) / width - 1
        place_y = (2 * by_frame(y[:, :, number]) + 1) / height - 1
        place = torch.stack([place_x, place_y], dim=-1)
        sampled = F.grid_sample(maps, place.to(maps.dtype), align_corners=False)
        total = total + (sampled * by_frame(weight[:, :, number])[:, None]).sum(dim=-1)
    return total.view(batch_size, dim, -1).transpose(1, 2).flatten(0, 1)


class SumOfRows(torch.autograd.Function):
    """``out[k] = sum_i weights[i] * rows[index[i]]``, i from ``offsets[k]`` to ``offsets[k + 1]``.

    The sum is `embedding_bag`'s. Its own backward for the rows is slow, so here that is another
    `embedding_bag`, over the entries sorted by row.
    """

    @staticmethod
    def forward(
        ctx,
        rows: Float[Tensor, "n d"],
        index: Int[Tensor, "i"],
        weights: Float[Tensor, "i"],
        offsets: Int[Tensor, "borders"],
    ) -> Float[Tensor, "k d"]:
        ctx.save_for_backward(rows, index, weights, offsets)
        return _summed(rows, index, weights, offsets)

    @staticmethod
    def backward(ctx, grad: Float[Tensor, "k d"]):
        rows, index, weights, offsets = ctx.saved_tensors
        grad = grad.contiguous()

        bag_of = torch.repeat_interleave(offsets.diff(), output_size=len(index))
        sorted_index, order = index.sort()
        every_row = torch.arange(len(rows) + 1, dtype=index.dtype, device=index.device)
        row_offsets = torch.searchsorted(sorted_index, every_row, out_int32=True)
        grad_rows = _summed(grad, bag_of[order], weights[order], row_offsets)

        if not ctx.needs_input_grad[2]:
            return grad_rows, None, None, None
        # The operator that PyTorch itself takes for the gradient of the weights.
        grad_weights = torch.ops.aten._embedding_bag_per_sample_weights_backward(
            grad, rows, index, offsets, bag_of, 0
        )
        return grad_rows, None, grad_weights, None


def _summed(rows, index, weights, offsets) -> Float[Tensor, "k d"]:
    return F.embedding_bag(
        index, rows, offsets, mode="sum", per_sample_weights=weights, include_last_offset=True
    )


def bilinear_corners(
    x: Samples, y: Samples, sizes: Sequence[tuple[int, int]], base: Int[Tensor, "heads 1 1 r"]
) -> tuple[Int[Tensor, "heads 4 points levels r"], Float[Tensor, "heads 4 points levels r"]]:
    """Returns rows of the table (int32) and weights of each place's four neighbours.

    ``sizes`` are the levels' (height, width) without border; ``base`` is the row where the place's
    table starts. What lies outside a level falls on its border: zero.
    """
    height, width = torch.tensor(sizes, dtype=torch.int32, device=x.device).T[..., None]
    cells = (height + 2) * (width + 2)
    start = cells.cumsum(0, dtype=torch.int32) - cells

    column, fraction_x = _split(x, width)
    row, fraction_y = _split(y, height)
    corner = (row + 1) * (width + 2) + column + (start + 1 + base)
    below = corner + (width + 2)
    index = torch.stack([corner, corner + 1, below, below + 1], dim=1)

    rest_x, rest_y = 1 - fraction_x, 1 - fraction_y
    weight = torch.stack(
        [rest_y * rest_x, rest_y * fraction_x, fraction_y * rest_x, fraction_y * fraction_x], dim=1
    )
    return index, weight


class Transposed(torch.autograd.Function):
    """A matrix transposed in memory, and its gradient likewise: block by block, not by strides."""

    @staticmethod
    def forward(ctx, matrix: Shaped[Tensor, "m n"]) -> Shaped[Tensor, "n m"]:
        return matrix.T.contiguous()

    @staticmethod
    def backward(ctx, grad: Float[Tensor, "n m"]) -> Float[Tensor, "m n"]:
        return grad.T.contiguous()


def _split(x: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """Returns integer and fraction of a coordinate held in [-1, size], where the border is."""
    held = torch.minimum(x.clamp(min=-1), size)
    floor = torch.minimum(held.detach().floor(), size - 1)
    # What is not a number has no place; as a weight it tells the loss.
    return floor.nan_to_num(-1.0).to(torch.int32), held - floor
