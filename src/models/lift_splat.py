"""Pillars from the image through a predicted depth distribution (Lift-Splat-Shoot)."""

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid, inverse, transform
from .backbone import STRIDES
from .heights import height_projections, projected_sum
from .references import References, rays_camera
from .sampling import SumOfRows
from .tensors import Features, Pillars, Queries

# Cell of every pixel of the batch at every depth, and a truth value for each.
Cells = Int[Tensor, "n bins"]
Inside = Bool[Tensor, "n bins"]


class LiftSplat(nn.Module):
    """Spreads every feature pixel along its ray, and sums where it falls.

    This is the method of Philion and Fidler 2020, Sec. 3.

    Lift: of each pixel of one level, a context vector and a softmax over depth bins. Splat: the
    point at each bin's center falls into a pillar and one of ``num_heights`` equal slices of
    ``grid``, where the context is added with the bin's probability; each slice has an output
    projection. Points outside the grid count for nothing, and a pillar that none falls into gets
    exactly zero. A ray's points are as far apart as the bins, and the rays as the pixels: pillars
    far away can lie between them.

    ``stride`` names the level. Bins are z-depths, ``step_m`` wide, from ``near_m`` to ``far_m``;
    without them, as wide as a voxel and as far as the grid's farthest corner is from the UAV. The
    query is not read.

    Raises `UserError` for a stride that the pyramid lacks, and where there would be no bin.
    """

    reads_query = False

    def __init__(
        self,
        dim: int,
        num_heights: int,
        grid: VoxelGrid,
        stride: int = 16,
        near_m: float = 1.0,
        far_m: float | None = None,
        step_m: float | None = None,
    ) -> None:
        super().__init__()
        if stride not in STRIDES:
            raise UserError(f"model.encoder.lift.stride: {stride} is not one of {list(STRIDES)}")

        self.grid, self.stride, self.reads_strides = grid, stride, (stride,)
        self.near_m = near_m
        self.step_m = grid.voxel_m if step_m is None else step_m
        far_m = farthest_m(grid) if far_m is None else far_m
        if not (0 < near_m < far_m and self.step_m > 0):
            raise UserError(
                f"model.encoder.lift.near_m: must be above 0 and below far_m, and step_m above 0; "
                f"they are {near_m}, {far_m} and {self.step_m}"
            )
        # Rounding must not add a bin where the width divides the range.
        self.num_bins = math.ceil((far_m - near_m) / self.step_m - 1e-6)

        self.context = nn.Linear(dim, dim)
        self.depth = nn.Linear(dim, self.num_bins)
        self.output = height_projections(num_heights, dim)

    def forward(self, query: Queries | None, features: Features, references: References) -> Pillars:
        """Returns the update of every pillar, from feature maps at the strides of the backbone."""
        feature = features[STRIDES.index(self.stride)]
        batch_size, _, height, width = feature.shape
        pixels = feature.permute(0, 2, 3, 1).flatten(0, 2)
        probability = self.depth(pixels).softmax(dim=-1)

        cell, inside = self._cells(references, width, height)
        num_cells = references.valid.shape[:2].numel() * len(self.output)
        by_height = splat(self.context(pixels), probability, cell, inside, num_cells)
        return projected_sum(by_height, self.output, batch_size)

    def _cells(self, references: References, width: int, height: int) -> tuple[Cells, Inside]:
        """Returns the cell of every pixel at every depth, and which of them lie in the grid.

        Cells are numbered by frame, pillar and height, as the references are.
        """
        points = self._points(references, width, height)
        index, inside = self.grid.index_of(points)
        x, y, _ = index.unbind(-1)

        lower_m, upper_m = self.grid.lower_m[2], self.grid.upper_m[2]
        slices = len(self.output)
        slice_ = ((points[..., 2] - lower_m) * (slices / (upper_m - lower_m))).floor()
        slice_ = slice_.clamp(0, slices - 1).to(torch.int64)

        rows, columns, _ = self.grid.shape
        frame = torch.arange(len(index), device=index.device)[:, None, None]
        cell = ((frame * rows + x) * columns + y) * slices + slice_
        return cell.flatten(0, 1), inside.flatten(0, 1)

    def _points(
        self, references: References, width: int, height: int
    ) -> Float[Tensor, "b n bins 3"]:
        """Returns the places of the level's pixels in the grid's frame, at every bin's center."""
        chain = references.camera_from_volume
        bins = torch.arange(self.num_bins, dtype=chain.dtype, device=chain.device)
        depth_m = self.near_m + (bins + 0.5) * self.step_m
        # Autocast would round coordinates to 8 bits.
        with torch.autocast(chain.device.type, enabled=False):
            at_one_metre = rays_camera(width, height, self.stride, references.pix_from_camera)
            points_camera = at_one_metre[:, :, None] * depth_m[:, None]
            points = transform(inverse(chain), points_camera.flatten(1, 2))
        return points.unflatten(1, (-1, self.num_bins))


def splat(
    context: Float[Tensor, "n dim"],
    probability: Float[Tensor, "n bins"],
    cell: Cells,
    inside: Inside,
    num_cells: int,
) -> Float[Tensor, "{num_cells} dim"]:
    """Sums in every cell the contexts that fall into it, weighted with their probabilities.

    The products are never stored: they are the terms of one `embedding_bag` over the points sorted
    by cell, which at the paper's size is several times faster than `index_add`. An exported graph
    adds them all the same: other runtimes do not know the sum, nor shapes that depend on values.
    """
    if torch.compiler.is_exporting():
        return splat_by_adding(context, probability, cell, inside, num_cells)

    point = inside.flatten().nonzero()[:, 0]
    # Stable: a cell's sum has one order, whatever else is in the batch.
    cell, order = cell.flatten()[point].to(torch.int32).sort(stable=True)
    point = point[order]

    every_cell = torch.arange(num_cells + 1, dtype=torch.int32, device=cell.device)
    offsets = torch.searchsorted(cell, every_cell, out_int32=True)
    row = torch.div(point, probability.shape[1], rounding_mode="floor").to(torch.int32)
    weights = probability.flatten().index_select(0, point).to(context.dtype)
    return SumOfRows.apply(context, row, weights, offsets)


def splat_by_adding(
    context, probability, cell, inside, num_cells
) -> Float[Tensor, "{num_cells} dim"]:
    """Computes `splat` with every product stored and added to its cell."""
    products = (context[:, None] * probability[..., None]).flatten(0, 1)
    # What lies outside goes to one cell more, which is dropped.
    cell = torch.where(inside, cell, num_cells).flatten()
    cells = products.new_zeros(num_cells + 1, products.shape[-1])
    return cells.index_add(0, cell, products)[:num_cells]


def farthest_m(grid: VoxelGrid) -> float:
    """Returns the distance of the grid's farthest corner from the UAV."""
    return math.hypot(*(max(abs(l), abs(u)) for l, u in zip(grid.lower_m, grid.upper_m)))
