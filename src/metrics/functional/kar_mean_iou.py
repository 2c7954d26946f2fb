"""KAR-mIoU as the paper writes it. The metrics compute the same number faster."""

import torch
from jaxtyping import Float
from torch import Tensor

from ...geometry import VoxelGrid
from .codes import Labels, Mask, Preds, Velocity
from .penalty import FIXED_POINT


def kar_mean_iou(
    preds: Preds,
    target: Labels,
    velocity: Velocity,
    grid: VoxelGrid,
    mask: Mask | None = None,
    num_classes: int = 9,
    free_index: int = 8,
    ignore_index: int | None = 255,
    horizon_s: float = 5.0,
    decay_per_s: float = 0.5,
    penalty_scale: float = 2.0,
    min_speed_mps: float = 5.0,
) -> tuple[Float[Tensor, ""], Float[Tensor, "c"]]:
    """Returns KAR-mIoU of a batch, and KAR-IoU of every class (Sec. 3.3, Eq. 3 and Eq. 4).

    This is the definition, to be read. `KARMeanIoU` gives the same bits from integer counts that
    add up over a dataset; its arguments have the same names. A class with no TP, FP or FN is NaN
    and left out of the mean. The input is not checked. float64, on the device of ``target``.
    """
    labels = preds.argmax(dim=1) if preds.is_floating_point() else preds
    known = target == target if ignore_index is None else target != ignore_index
    if mask is not None:
        known = known & mask

    # Eq. 3, left: TTC as if every direction were the one of flight. A hovering UAV counts as slow,
    # not as standing (v_min of App. A.4 in place of the main text's epsilon). Nanometres are cut
    # off, so that a voxel just on the horizon lies inside it whatever the order of additions.
    velocity = velocity if velocity.ndim == 2 else velocity[:, None]
    speed_mps = velocity.double().norm(dim=1).clamp(min=min_speed_mps)
    distance_m = grid.centers(torch.float64, target.device).norm(dim=-1).round(decimals=9)
    ttc_s = distance_m / speed_mps[:, None, None, None]

    # Eq. 3, right: the weight p of an error, 1 beyond the horizon. It is rounded to steps of 2^-24:
    # sums of such numbers are exact, hence the same in any order, of batches or of processes.
    excess = (ttc_s <= horizon_s) * penalty_scale * torch.exp(-decay_per_s * ttc_s)
    weight = 1 + torch.round(excess * FIXED_POINT) / FIXED_POINT

    # Eq. 4, class by class: correct voxels count 1 wherever they are, errors their weight.
    kar_iou = torch.full((num_classes,), torch.nan, dtype=torch.float64, device=target.device)
    for class_id in range(num_classes):
        true, predicted = known & (target == class_id), known & (labels == class_id)
        hits = (true & predicted).sum()
        errors = weight[true ^ predicted].sum()  # over FP and FN
        kar_iou[class_id] = hits / (hits + errors)

    # Free space is nearly all of a frame, and would be nearly all of a mean.
    occupied = [class_id for class_id in range(num_classes) if class_id != free_index]
    return kar_iou[occupied].nanmean(), kar_iou
