"""One byte per voxel, ``16 * target + prediction``, and everything that is refused on the way."""

import torch
from jaxtyping import Bool, Float, Integer, UInt8
from torch import Tensor

from ...errors import UserError

# A batch: class ids of any integer dtype, or scores of the classes; velocities or speeds in m/s.
Labels = Integer[Tensor, "b X Y Z"]
Logits = Float[Tensor, "b c X Y Z"]
Preds = Labels | Logits
Velocity = Float[Tensor, "b 3"] | Float[Tensor, "b"]
Mask = Bool[Tensor, "b X Y Z"]
# A frame: its bytes, and a place or a velocity, directions.
Codes = UInt8[Tensor, "X Y Z"]
Vector = Float[Tensor, "3"]
Rays = Float[Tensor, "n 3"]

# Four bits hold a class id, and their last value stands for a voxel that is not counted.
MAX_CLASSES = 15
CODES = 256
UNCOUNTED = 255
_NO_CLASS = 254

# Stands for the class that a ray or a path meets where it meets nothing.
NOTHING = 255


def encode(
    labels: Labels, target: Labels, mask: Mask | None, num_classes: int, ignore_index: int | None
) -> UInt8[Tensor, "b X Y Z"]:
    """Returns one byte per voxel: ``16 * target + prediction``, or 255 where nothing is counted.

    Counted is every voxel whose target is not ``ignore_index`` and which the mask, if there is one,
    holds. Raises `UserError` for class ids at counted voxels outside 0 to ``num_classes - 1``.
    """
    known = _target_bytes(target, ignore_index)
    if mask is not None:
        known = known | (mask.view(torch.uint8) - 1)

    # 255 wraps to 0 here, and below it has a high bit that no class has. Comparing, selecting and
    # masking would be several times slower than arithmetic on bytes.
    last = num_classes - 1
    ignored = "" if ignore_index is None else f" or {ignore_index}"
    _check_ids("target", f"0 to {last}{ignored}", known + 1, num_classes + 1)
    labels = _bytes(labels)
    _check_ids("preds", f"0 to {last}", labels & ((known >> 7) - 1), num_classes)
    return (known << 4) | labels | (known >> 4)


def labels_of(preds: Preds) -> Labels:
    """Returns labels as they are, and of logits the class of the highest.

    Raises `UserError` for NaN.
    """
    if not preds.is_floating_point():
        return preds
    # `max` along a strided dimension is several times faster than `argmax` on the CPU.
    highest, labels = preds.detach().max(dim=1)
    if highest.numel() and highest.amax().isnan():
        raise UserError("preds: the logits hold NaN; look for a loss that diverged")
    return labels


def _target_bytes(target: Labels, ignore_index: int | None) -> UInt8[Tensor, "b X Y Z"]:
    if ignore_index == UNCOUNTED:
        return _bytes(target)
    target = target.long()
    target = torch.where(target == UNCOUNTED, _NO_CLASS, target)
    if ignore_index is not None:
        target = torch.where(target == ignore_index, UNCOUNTED, target)
    return _bytes(target)


def _bytes(ids: Integer[Tensor, "*v"]) -> UInt8[Tensor, "*v"]:
    """Casts class ids to bytes; what does not fit becomes an id that is never valid."""
    if ids.dtype == torch.uint8 or ids.numel() == 0:
        return ids.to(torch.uint8)
    ids = ids.long()
    lowest, highest = ids.aminmax()
    if lowest < 0 or highest > 255:
        ids = torch.where((ids < 0) | (ids > 255), _NO_CLASS, ids)
    return ids.to(torch.uint8)


def _check_ids(name: str, allowed: str, ids: UInt8[Tensor, "*v"], bound: int) -> None:
    if ids.numel() and ids.amax() >= bound:
        raise UserError(f"{name}: holds a class id at a counted voxel that is not {allowed}")
