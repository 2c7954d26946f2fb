"""A batch as [target, prediction] tables, one for every frame and bin of space.

Row c of a table off the diagonal holds the false negatives of class c, column c its false
positives. There are two: how many voxels, and the sum of their excess penalties. On the CPU one
compiled pass makes them, elsewhere and on request plain torch, to the same bits.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int, Int64, UInt8
from torch import Tensor

from ...errors import UserError
from . import codes as C

BACKENDS = ("auto", "numba", "torch")


@dataclass(frozen=True)
class Space:
    """Where the voxels of a batch lie, by their distance from the UAV.

    ``shell`` names each voxel's distance, ``excess`` the penalty of every frame at every distance.
    ``bins`` sorts the distances of a frame into ``n_bins`` bins; null is one bin for all.
    """

    shell: Int[Tensor, "v"]
    excess: Int64[Tensor, "b s"]
    bins: Int[Tensor, "b s"] | None = None
    n_bins: int = 1


@dataclass(frozen=True)
class Classes:
    """Which ids are classes, and which one stands for a voxel without a label."""

    num_classes: int
    ignore_index: int


Tables = tuple[Int64[Tensor, "b m k c c"], Int64[Tensor, "b m k c c"]]


def confusion_tables(
    preds: Int[Tensor, "b X Y Z"] | Float[Tensor, "b c X Y Z"],
    target: Int[Tensor, "b X Y Z"],
    mask: Bool[Tensor, "b X Y Z"] | None,
    marked: Bool[Tensor, "b X Y Z"] | None,
    space: Space,
    classes: Classes,
    backend: str = "auto",
) -> Tables:
    """Voxel counts and excess penalties of every frame, by ``marked`` (m), bin (k), target and
    prediction.

    Counted is every voxel whose target is not ``ignore_index`` and which ``mask``, if there is one,
    holds. Without ``marked`` the first of two values stands for all (m is 1). Shapes are taken to
    fit (`codes.check_shapes`). Raises `UserError` for NaN logits and for class ids at counted
    voxels outside 0 to ``num_classes - 1``.
    """
    labels = C.labels_of(preds)
    if compiled(backend, labels.device):
        tables = _by_numba(labels, target, mask, marked, space, classes)
    else:
        tables = _by_torch(labels, target, mask, marked, space, classes)
    shape = (len(target), 1 if marked is None else 2, space.n_bins, 16, 16)
    count, excess = (table.view(shape) for table in tables)
    kept = slice(classes.num_classes)
    return count[..., kept, kept], excess[..., kept, kept]


def compiled(backend: str, device: torch.device) -> bool:
    """Whether the compiled pass is to be taken. Raises `UserError` where it cannot be."""
    if backend not in BACKENDS:
        raise UserError(f"backend: {backend!r} is none of {', '.join(BACKENDS)}")
    if backend == "numba" and device.type != "cpu":
        raise UserError(f"backend: numba runs on the CPU, not on {device}; take auto or torch")
    return backend != "torch" and device.type == "cpu"


def _by_torch(
    labels: Int[Tensor, "b X Y Z"],
    target: Int[Tensor, "b X Y Z"],
    mask: Bool[Tensor, "b X Y Z"] | None,
    marked: Bool[Tensor, "b X Y Z"] | None,
    space: Space,
    classes: Classes,
) -> tuple[Int64[Tensor, "b t"], Int64[Tensor, "b t"]]:
    encoded = C.encode(labels, target, mask, classes.num_classes, classes.ignore_index).flatten(1)
    size = C.CODES * space.n_bins * (1 if marked is None else 2)
    count = torch.zeros(len(encoded), size, dtype=torch.int64, device=encoded.device)
    penalty = torch.zeros_like(count)
    for n, frame in enumerate(encoded):
        cell = _cells(frame, n, marked, space)
        count[n] = torch.bincount(cell, minlength=size)
        wrong = torch.nonzero((frame ^ (frame >> 4)) & 15).squeeze(1)
        excess = space.excess[n].index_select(0, space.shell.index_select(0, wrong))
        penalty[n].scatter_add_(0, cell.index_select(0, wrong).long(), excess)
    return count, penalty


def _cells(
    frame: UInt8[Tensor, "v"], n: int, marked: Bool[Tensor, "b X Y Z"] | None, space: Space
) -> Int[Tensor, "v"]:
    """Where in the flat tables of a frame each voxel belongs."""
    if marked is None and space.bins is None:
        return frame
    cell = frame.to(torch.int32)
    if space.bins is not None:
        cell += C.CODES * space.bins[n].to(torch.int32).index_select(0, space.shell)
    if marked is not None:
        cell += C.CODES * space.n_bins * marked[n].flatten().to(torch.int32)
    return cell


def _by_numba(
    labels: Int[Tensor, "b X Y Z"],
    target: Int[Tensor, "b X Y Z"],
    mask: Bool[Tensor, "b X Y Z"] | None,
    marked: Bool[Tensor, "b X Y Z"] | None,
    space: Space,
    classes: Classes,
) -> tuple[Int64[Tensor, "b t"], Int64[Tensor, "b t"]]:
    # Only here: importing the compiler takes a second.
    from . import kernels

    size = C.CODES * space.n_bins * (1 if marked is None else 2)
    count = torch.zeros(len(target), size, dtype=torch.int64)
    penalty = torch.zeros_like(count)
    shell = space.shell.numpy()
    ids = (classes.num_classes, classes.ignore_index)
    for n in range(len(target)):
        voxels = (_flat_ids(labels[n]), _flat_ids(target[n]))
        tables = (count[n].numpy(), penalty[n].numpy())
        excess = space.excess[n].numpy()
        if mask is None and marked is None and space.bins is None:
            fault = kernels.count_frame(*voxels, shell, excess, *ids, *tables)
        else:
            bins = None if space.bins is None else space.bins[n].to(torch.int32).numpy()
            flags = (_flat(mask, n), _flat(marked, n))
            fault = kernels.sort_frame(
                *voxels, *flags, shell, bins, space.n_bins, excess, *ids, *tables
            )
        if fault == kernels.BAD_TARGET:
            raise C.bad_id(*C.target_rule(*ids))
        if fault == kernels.BAD_PREDS:
            raise C.bad_id(*C.preds_rule(classes.num_classes))
    return count, penalty


def _flat(mask: Bool[Tensor, "b X Y Z"] | None, n: int) -> object:
    return None if mask is None else mask[n].reshape(-1).numpy()


def _flat_ids(ids: Int[Tensor, "X Y Z"]) -> object:
    """As numpy, of one of the two dtypes that are compiled."""
    if ids.dtype not in (torch.uint8, torch.int64):
        ids = ids.long()
    return ids.detach().reshape(-1).numpy()
