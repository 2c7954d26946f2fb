"""Bilinear sampling of several feature levels as one weighted sum of table rows.

Four corners, levels and points of a reference are all summed in the end, so nothing but the sum is
ever stored: one `embedding_bag`, three times faster on a CPU, forward and backward, than
`grid_sample` by level, and it returns the same gradient every time on a GPU.
"""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor


class SumOfRows(torch.autograd.Function):
    """``out[k] = sum_i weights[i] * rows[index[i]]`` over ``i`` in [offsets[k], offsets[k + 1]).

    An empty range sums to zero. Same as `embedding_bag`; its own backward for the rows is slow, so
    here it is another `embedding_bag`, over the entries sorted by row.
    """

    @staticmethod
    def forward(
        ctx,
        rows: Float[Tensor, "n d"],
        index: Int[Tensor, "i"],
        weights: Float[Tensor, "i"],
        offsets: Int[Tensor, "k+1"],
    ) -> Float[Tensor, "k d"]:
        ctx.save_for_backward(rows, index, weights, offsets)
        return _bag(rows, index, weights, offsets)

    @staticmethod
    def backward(ctx, grad: Float[Tensor, "k d"]):
        rows, index, weights, offsets = ctx.saved_tensors
        grad = grad.contiguous()
        bags = torch.arange(len(grad), dtype=index.dtype, device=index.device)
        bag_of = bags.repeat_interleave(offsets.diff(), output_size=len(index))
        sorted_index, order = index.sort()
        every_row = torch.arange(len(rows) + 1, dtype=index.dtype, device=index.device)
        row_offsets = torch.searchsorted(sorted_index, every_row, out_int32=True)
        grad_rows = _bag(grad, bag_of[order], weights[order], row_offsets)
        grad_weights = torch.ops.aten._embedding_bag_per_sample_weights_backward(
            grad, rows, index, offsets, bag_of, 0
        )
        return grad_rows, None, grad_weights, None


def _bag(rows: Tensor, index: Tensor, weights: Tensor, offsets: Tensor) -> Tensor:
    return F.embedding_bag(
        index, rows, offsets, mode="sum", per_sample_weights=weights, include_last_offset=True
    )


def bordered_rows(
    levels: Sequence[Float[Tensor, "b h w dim"]],
) -> Float[Tensor, "b s dim"]:
    """One table of all levels, each with a border of zeros one cell wide."""
    return torch.cat([F.pad(level, (0, 0, 1, 1, 1, 1)).flatten(1, 2) for level in levels], dim=1)


def bilinear_corners(
    x: Float[Tensor, "*batch levels r"],
    y: Float[Tensor, "*batch levels r"],
    sizes: Sequence[tuple[int, int]],
    base: Int[Tensor, "*#batch r"],
) -> tuple[Int[Tensor, "4 *batch levels r"], Float[Tensor, "4 *batch levels r"]]:
    """Rows of `bordered_rows` (int32) and weights of each location's four neighbours.

    ``x`` and ``y`` are pixels of the level with integers at pixel centres; ``sizes`` are the
    levels' (height, width) without border; ``base`` is the row where the location's table starts.
    What lies outside a level falls on its border: zero.
    The many locations are the last dimension, which keeps the arithmetic vectorised.
    """
    height, width = torch.tensor(sizes, dtype=torch.int32, device=x.device).T[..., None]
    cells = (height + 2) * (width + 2)
    start = cells.cumsum(0, dtype=torch.int32) - cells
    column, fraction_x = _split(x, width)
    row, fraction_y = _split(y, height)
    corner = (row + 1) * (width + 2) + column + (start + 1 + base)
    index = torch.stack([corner, corner + 1, corner + width + 2, corner + width + 3])
    rest_x, rest_y = 1 - fraction_x, 1 - fraction_y
    weight = torch.stack(
        [rest_y * rest_x, rest_y * fraction_x, fraction_y * rest_x, fraction_y * fraction_x]
    )
    return index, weight


def _split(x: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """Integer and fraction of a coordinate held in [-1, size], where the border is."""
    held = torch.minimum(x.clamp(min=-1), size)
    floor = torch.minimum(held.detach().floor(), size - 1)
    return floor.to(torch.int32), held - floor
