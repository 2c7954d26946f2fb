"""IoU and KAR-IoU as pure functions of two integer tables (Sec. 3.3 and App. A.4 of the paper).

A batch becomes one byte per voxel, ``target * 16 + prediction`` (`encode`), and the bytes become
two [target, prediction] tables (`confusion_update`): how many voxels, and the sum of their excess
penalties ``p - 1``. Row c off the diagonal holds the false negatives of class c, column c its false
positives. Both tables are int64, so sums over batches, ranks and devices are exact in any order.

An excess penalty is a multiple of ``1 / FIXED_POINT``: rounding moves a voxel's weight, which is at
least 1, by at most 3e-8. A table overflows after ``2**63 / (FIXED_POINT * penalty_scale)`` errors
at zero distance, 2.7e11 with the paper's parameters: 100 times the paper's test set, all of it
wrong.
"""

import math

import torch
from jaxtyping import Bool, Float, Int, Int64, Num, UInt8
from torch import Tensor

from ..errors import UserError
from ..geometry import VoxelGrid

FIXED_POINT = 2**24
MAX_CLASSES = 15
"""Four bits hold a class id, and their last value stands for a voxel that is not counted."""

_UNCOUNTED = 255
_NO_CLASS = 254


# ------------------------------------------------------------------------------------ penalties


def ttc_penalty(
    grid: VoxelGrid,
    velocity: Float[Tensor, "b 3"] | Float[Tensor, "b"],
    horizon_s: float = 5.0,
    decay_per_s: float = 0.5,
    penalty_scale: float = 2.0,
    min_speed_mps: float = 5.0,
) -> Float[Tensor, "b X Y Z"]:
    """Weight of an error at every voxel, from the omnidirectional worst-case time to collision.

    With x the voxel's centre in the occ frame and v the UAV's velocity (App. A.4)::

        ttc = |x| / max(|v|, min_speed_mps)
        p   = 1 + [ttc <= horizon_s] * penalty_scale * exp(-decay_per_s * ttc)

    ``velocity`` holds vectors or speeds in m/s. The result is float64, on the CPU.

    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(20, 1, 1), shape=(10, 1, 1))
    >>> [round(p, 3) for p in ttc_penalty(grid, torch.tensor([2.0]))[0, :, 0, 0].tolist()[:3]]
    [2.81, 2.482, 2.213]
    """
    distance_m = _distance_m(grid)
    speeds_mps = speeds(velocity, batch=len(velocity))
    penalty = distance_m.new_empty(len(speeds_mps), *grid.shape)
    for row, speed_mps in zip(penalty, speeds_mps):
        row[:] = 1 + _excess(
            distance_m, speed_mps, horizon_s, decay_per_s, penalty_scale, min_speed_mps
        )
    return penalty


def check_penalty(
    horizon_s: float, decay_per_s: float, penalty_scale: float, min_speed_mps: float
) -> None:
    """Raise `UserError` for a parameter with which the penalty would not be one."""
    for name, value in (
        ("horizon_s", horizon_s),
        ("decay_per_s", decay_per_s),
        ("penalty_scale", penalty_scale),
    ):
        if not (math.isfinite(value) and value >= 0):
            raise UserError(f"{name}: {value} must be a finite number, not below 0")
    if not (math.isfinite(min_speed_mps) and min_speed_mps > 0):
        raise UserError(f"min_speed_mps: {min_speed_mps} must be a finite number above 0")


def speeds(velocity: Num[Tensor, "b 3"] | Num[Tensor, "b"], batch: int) -> list[float]:
    """Speed in m/s of every frame of a batch, from its velocities or speeds.

    Raises `UserError` for another shape and for a number that is not finite.
    """
    if velocity.shape not in ((batch,), (batch, 3)):
        raise UserError(
            f"velocity: shape {list(velocity.shape)} does not fit a batch of {batch}; "
            f"give [{batch}, 3] velocities or [{batch}] speeds in m/s"
        )
    components = velocity.detach().double()
    rows = (components if velocity.ndim == 2 else components[:, None]).tolist()
    speeds_mps = [math.hypot(*row) for row in rows]
    if not all(math.isfinite(speed_mps) for speed_mps in speeds_mps):
        raise UserError("velocity: holds NaN or infinity; give finite velocities in m/s")
    return speeds_mps


def distance_shells(
    grid: VoxelGrid,
) -> tuple[Float[Tensor, "s"], Int[Tensor, "v"]]:
    """The distinct distances of voxel centres from the UAV in metres, and each voxel's own.

    The paper's 600,000 voxels have but 6,559 distances, so a frame's penalties are a small table.
    It is computed on the CPU and at the same place in memory order whatever the batch: an
    exponential may differ in its last bit between devices, and between the middle and the end of a
    vectorised loop.
    """
    rounded_m = _distance_m(grid).flatten().round(decimals=9)
    shell_m, shell = torch.unique(rounded_m, return_inverse=True)
    return shell_m, shell.to(torch.int32)


def excess_table(
    shell_m: Float[Tensor, "s"],
    speeds_mps: list[float],
    horizon_s: float,
    decay_per_s: float,
    penalty_scale: float,
    min_speed_mps: float,
) -> Int64[Tensor, "b s"]:
    """Excess penalty ``p - 1`` of every frame at every distance, in units of 1 / FIXED_POINT."""
    table = torch.empty(len(speeds_mps), len(shell_m), dtype=torch.int64)
    for row, speed_mps in zip(table, speeds_mps):
        excess = _excess(shell_m, speed_mps, horizon_s, decay_per_s, penalty_scale, min_speed_mps)
        row[:] = torch.round(excess * FIXED_POINT)
    return table


def _excess(
    distance_m: Float[Tensor, "*v"],
    speed_mps: float,
    horizon_s: float,
    decay_per_s: float,
    penalty_scale: float,
    min_speed_mps: float,
) -> Float[Tensor, "*v"]:
    ttc_s = distance_m / max(speed_mps, min_speed_mps)
    return (ttc_s <= horizon_s) * penalty_scale * torch.exp(-decay_per_s * ttc_s)


def _distance_m(grid: VoxelGrid) -> Float[Tensor, "X Y Z"]:
    return grid.centers(torch.float64).square().sum(-1).sqrt()


# --------------------------------------------------------------------------------------- update


def encode(
    preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
    target: Int[Tensor, "b X Y Z"],
    mask: Bool[Tensor, "b X Y Z"] | None,
    shape: tuple[int, int, int],
    num_classes: int,
    ignore_index: int,
) -> UInt8[Tensor, "b X Y Z"]:
    """One byte per voxel: ``target * 16 + prediction``, or 255 where nothing is counted.

    Counted is every voxel whose target is not ``ignore_index`` and which the mask, if there is one,
    holds. Raises `UserError` for shapes that do not fit each other or the grid's ``shape``, for
    dtypes that are neither labels nor logits, for NaN logits, and for class ids at counted voxels
    outside 0 to ``num_classes - 1``.
    """
    _check_shapes(preds, target, mask, shape, num_classes)
    known = _target_bytes(target, ignore_index)
    if mask is not None:
        known = known | (mask.view(torch.uint8) - 1)
    # 255 wraps to 0 here, and below it has a high bit that no class has. Comparing, selecting and
    # masking would be several times slower than arithmetic on bytes.
    _check_ids("target", known + 1, num_classes + 1, f"0 to {num_classes - 1} or {ignore_index}")
    labels = _bytes(_argmax(preds) if preds.is_floating_point() else preds)
    _check_ids("preds", labels & ((known >> 7) - 1), num_classes, f"0 to {num_classes - 1}")
    return (known << 4) | labels | (known >> 4)


def confusion_update(
    codes: UInt8[Tensor, "b X Y Z"],
    shell: Int[Tensor, "v"],
    excess: Int64[Tensor, "b s"],
    num_classes: int,
) -> tuple[Int64[Tensor, "c c"], Int64[Tensor, "c c"]]:
    """The [target, prediction] tables of a batch: voxel counts, and sums of the excess penalty."""
    count = torch.bincount(codes.flatten(), minlength=256)
    penalty = torch.zeros_like(count)
    for frame, excess_at in zip(codes.flatten(1), excess):
        wrong = torch.nonzero((frame ^ (frame >> 4)) & 15).squeeze(1)
        excess_of_wrong = excess_at.index_select(0, shell.index_select(0, wrong))
        penalty.scatter_add_(0, frame.index_select(0, wrong).long(), excess_of_wrong)
    return tuple(table.view(16, 16)[:num_classes, :num_classes] for table in (count, penalty))


def _check_shapes(
    preds: Tensor,
    target: Tensor,
    mask: Tensor | None,
    shape: tuple[int, int, int],
    num_classes: int,
) -> None:
    if target.ndim != 4 or tuple(target.shape[1:]) != shape:
        raise UserError(
            f"target: shape {list(target.shape)} is not [B, X, Y, Z] of the grid {list(shape)}"
        )
    if target.is_floating_point() or target.dtype == torch.bool:
        raise UserError(f"target: {target.dtype} holds no class ids; give an integer dtype")
    if preds.dtype == torch.bool or preds.is_complex():
        raise UserError(f"preds: {preds.dtype} is neither integer labels nor float logits")
    classes = (num_classes,) if preds.is_floating_point() else ()
    if preds.shape != (len(target), *classes, *shape):
        kind = "logits" if classes else "labels"
        raise UserError(
            f"preds: {kind} of shape {list(preds.shape)} do not fit the target, "
            f"which asks for {[len(target), *classes, *shape]}"
        )
    if mask is not None and (mask.dtype != torch.bool or mask.shape != target.shape):
        raise UserError(
            f"mask: {mask.dtype} {list(mask.shape)} must be bool {list(target.shape)}, "
            "as the target"
        )


def _argmax(logits: Float[Tensor, "b c X Y Z"]) -> Int64[Tensor, "b X Y Z"]:
    # `max` along a strided dimension is several times faster than `argmax` on the CPU.
    highest, labels = logits.detach().max(dim=1)
    if highest.numel() and highest.amax().isnan():
        raise UserError("preds: the logits hold NaN; look for a loss that diverged")
    return labels


def _target_bytes(target: Int[Tensor, "b X Y Z"], ignore_index: int) -> UInt8[Tensor, "b X Y Z"]:
    if ignore_index == _UNCOUNTED:
        return _bytes(target)
    target = target.long()
    target = torch.where(target == _UNCOUNTED, _NO_CLASS, target)
    return _bytes(torch.where(target == ignore_index, _UNCOUNTED, target))


def _bytes(ids: Int[Tensor, "*v"]) -> UInt8[Tensor, "*v"]:
    if ids.dtype == torch.uint8 or ids.numel() == 0:
        return ids.to(torch.uint8)
    ids = ids.long()
    lowest, highest = ids.aminmax()
    if lowest < 0 or highest > 255:
        ids = torch.where((ids < 0) | (ids > 255), _NO_CLASS, ids)
    return ids.to(torch.uint8)


def _check_ids(name: str, ids: UInt8[Tensor, "*v"], bound: int, allowed: str) -> None:
    if ids.numel() and ids.amax() >= bound:
        raise UserError(f"{name}: holds a class id at a counted voxel that is not {allowed}")


# -------------------------------------------------------------------------------------- compute


def iou_compute(
    count: Int64[Tensor, "c c"], excess: Int64[Tensor, "c c"] | None = None
) -> Float[Tensor, "c"]:
    """IoU of every class; with the table of excess penalties, its KAR-IoU (App. A.4).

    ::

        KAR-IoU_c = TP_c / (TP_c + sum of p_i over FP_c + sum of p_i over FN_c),   p_i = 1 for IoU

    A class with no TP, FP or FN is NaN. float64.
    """
    true_positives = count.diagonal()
    errors = (count.sum(0) + count.sum(1) - 2 * true_positives).double()
    if excess is not None:
        errors = errors + (excess.sum(0) + excess.sum(1)).double() / FIXED_POINT
    return true_positives.double() / (true_positives.double() + errors)


def mean_iou(iou: Float[Tensor, "c"], without: int | None = None) -> Float[Tensor, ""]:
    """Mean over the classes that are not NaN, without one of them if asked; NaN if none is left."""
    kept = [class_id for class_id in range(len(iou)) if class_id != without]
    return iou[kept].nanmean()
