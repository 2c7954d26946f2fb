"""RayIoU: IoU of what the camera's rays meet first, and how far away."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid
from . import functional as F
from .count_metric import NamedCounts, Scores, VoxelMetric

# The columns of ``clear``: rays that truly meet nothing, and those predicted to.
CLEAR, PHANTOM = range(2)


class RayIoU(VoxelMetric):
    """RayIoU (SparseOcc, ECCV 2024) of any rays through any grid, on the CPU.

    Every ray meets a first occupied voxel in the prediction and in the labels, or none. It is a hit
    of class c if both are of class c and less than a threshold apart along the ray::

        RayIoU_c = hits_c / (rays that truly meet c + rays predicted to meet c - hits_c)

    over the rays that truly meet something; ``ray_iou`` is the mean over the occupied classes that
    occur and over the thresholds. Unlike IoU it does not reward thick surfaces. Voxels without a
    label are passed through, predicted or not. `compute` gives ``ray_iou``, ``ray_iou_<t>m`` of
    each threshold, ``ray_iou/<class>``, and ``ray_phantom_rate``: of the rays that truly meet
    nothing, the share predicted to meet something, which RayIoU itself leaves out.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([8, 8, 5, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([8, 5, 8, 8]).view(1, 4, 1, 1)    # the car seen 2 m too near
    >>> ahead = torch.tensor([[[1.0, 0.0, 0.0]]])
    >>> rays = RayIoU(grid)
    >>> rays.update(preds, target, torch.zeros(1, 3), ahead)
    >>> {f"{t} m": float(rays.compute()[f"ray_iou_{t}m"]) for t in (1, 2, 4)}
    {'1 m': 0.0, '2 m': 0.0, '4 m': 1.0}
    """

    hits: Tensor
    met: Tensor
    clear: Tensor

    def __init__(
        self,
        grid: VoxelGrid,
        *arguments: Any,
        thresholds_m: Sequence[float] = (1.0, 2.0, 4.0),
        **kwargs: Any,
    ) -> None:
        self.thresholds_m = tuple(map(float, thresholds_m))
        if not self.thresholds_m or not all(0 < t < math.inf for t in self.thresholds_m):
            raise UserError(f"thresholds_m: {list(self.thresholds_m)} must be numbers above 0")
        super().__init__(grid, *arguments, **kwargs)
        hits = (len(self.thresholds_m), self.num_classes)
        self.add_counts(hits=hits, met=(2, self.num_classes), clear=(2,))

    def frame_counts(
        self,
        preds: F.Preds,
        target: F.Labels,
        origin_m: Float[Tensor, "b 3"],
        directions: Float[Tensor, "b n 3"],
        mask: F.Mask | None = None,
    ) -> NamedCounts:
        """Returns ``hits`` [threshold, class], rays that ``met`` a class [(predicted, truly),
        class], and rays that are ``clear`` [(all, met a phantom)], of every frame.

        Rays are given by their origin and unit directions in the occ frame
        (`functional.camera_rays`). Raises `UserError` as the other metrics do, and for rays that
        are not finite or have no direction.
        """
        codes = self.codes(preds, target, mask)
        _check_rays(origin_m, directions, len(target))
        return self.stacked([self._frame(*frame) for frame in zip(codes, origin_m, directions)])

    def scores(self, counts: NamedCounts) -> Scores:
        """Returns the scores of counts as `frame_counts` gives them, summed."""
        hits, met, clear = (counts[name].double() for name in ("hits", "met", "clear"))
        iou = hits / (met.sum(-2, keepdim=True) - hits)
        by_threshold = F.mean_iou(iou, without=self.free_index)

        scores = {"ray_iou": by_threshold.mean(-1)}
        for n, threshold_m in enumerate(self.thresholds_m):
            scores[f"ray_iou_{threshold_m:g}m"] = by_threshold[..., n]
        scores |= self.of_classes("ray_iou", iou.mean(-2), without=[self.free_index])
        scores["ray_phantom_rate"] = clear[..., PHANTOM] / clear[..., CLEAR]
        return scores

    def _frame(self, codes: F.Codes, origin_m: F.Vector, directions: F.Rays) -> NamedCounts:
        first_met = F.first_met(codes, origin_m, directions, self.grid, self.free_index)
        classes, distances_m = map(torch.from_numpy, first_met)
        solid = distances_m[1] < torch.inf
        predicted, true = (row[solid].long() for row in classes)
        apart_m = (distances_m[0] - distances_m[1]).abs()[solid]

        def count(of_class: Int64[Tensor, "n"]) -> Int64[Tensor, "c"]:
            return torch.bincount(of_class, minlength=self.num_classes)

        # A ray that is predicted to meet nothing has no class to count.
        met = torch.stack([count(predicted[predicted < self.num_classes]), count(true)])
        same = predicted == true
        hits = torch.stack([count(true[same & (apart_m < t)]) for t in self.thresholds_m])
        phantom = distances_m[0][~solid] < torch.inf
        clear = torch.tensor([len(phantom), int(phantom.sum())])
        return {"hits": hits, "met": met, "clear": clear}


class CameraRayIoU(RayIoU):
    """RayIoU on rays of the front camera, evenly spread over its image.

    It takes the arguments of `RayIoU`, and

    Args:
        rays: how many rays go across and down the image.
    """

    def __init__(
        self, grid: VoxelGrid, *arguments: Any, rays: Sequence[int] = (100, 56), **kwargs: Any
    ) -> None:
        if len(rays) != 2 or not all(isinstance(number, int) and number > 0 for number in rays):
            raise UserError(f"rays: {list(rays)} must be two whole numbers, across and down")
        super().__init__(grid, *arguments, **kwargs)
        self.rays = tuple(rays)

    def frame_counts(
        self,
        preds: F.Preds,
        target: F.Labels,
        camera_from_occ: Float[Tensor, "b 4 4"],
        pix_from_camera: Float[Tensor, "b 3 3"],
        size_pix: tuple[int, int],
        mask: F.Mask | None = None,
    ) -> NamedCounts:
        """Returns the counts of `RayIoU`; ``size_pix`` is the image's width and height."""
        rays = F.camera_rays(camera_from_occ, pix_from_camera, size_pix, self.rays)
        return super().frame_counts(preds, target, *rays, mask)


def _check_rays(origin_m: Tensor, directions: Tensor, batch: int) -> None:
    if origin_m.shape != (batch, 3) or directions.ndim != 3 or directions.shape[::2] != (batch, 3):
        raise UserError(
            f"rays: origins {list(origin_m.shape)} and directions {list(directions.shape)} must be "
            f"[{batch}, 3] and [{batch}, N, 3]"
        )
    if not (origin_m.isfinite().all() and directions.isfinite().all()):
        raise UserError("rays: hold NaN or infinity; give finite origins and directions")
    length = directions.square().sum(-1)
    if length.numel() and (length - 1).abs().max() > 1e-4:
        raise UserError("rays: the directions are not of length 1; normalize them")
