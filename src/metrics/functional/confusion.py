"""A batch as tables [target, prediction], one for every frame and bin of space.

Row c of a table off the diagonal holds the false negatives of class c, column c its false
positives. There are two: how many voxels, and the sum of their excess penalties. On the CPU one
compiled pass makes them, elsewhere and on request plain torch, to the same bits.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int, Int64
from torch import Tensor

from ...errors import UserError
from .codes import CODES, Labels, Mask, encode

BACKENDS = ("auto", "numba", "torch")

Tables = tuple[Int64[Tensor, "b m k c c"], Int64[Tensor, "b m k c c"]]


@dataclass(frozen=True)
class Frames:
    """A batch of frames to count, whose shapes fit each other.

    ``shell`` names each voxel's distance from the UAV, and ``excess`` is what an error at each
    distance weighs more than 1 (`Penalty.excess_table`). ``bins`` sorts the distances of each frame
    into ``n_bins`` bins. Only voxels of ``mask`` count, and those of ``marked`` are kept apart.
    """

    labels: Labels
    target: Labels
    shell: Int[Tensor, "v"]
    excess: Int64[Tensor, "b s"]
    num_classes: int
    ignore_index: int
    mask: Mask | None = None
    marked: Mask | None = None
    bins: Sequence[Int[Tensor, "s"]] | None = None
    n_bins: int = 1

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The shape of a frame's table, before the classes are cut off at ``num_classes``."""
        return (1 if self.marked is None else 2), self.n_bins, 16, 16


def confusion_tables(frames: Frames, backend: str = "auto") -> Tables:
    """Returns voxel counts and excess penalties of every frame.

    They are sorted by ``marked`` (m), bin (k), target and prediction; without ``marked`` m is 1.
    Counted is every voxel whose target is not ``ignore_index`` and which the mask holds. Raises
    `UserError` for class ids at counted voxels outside 0 to ``num_classes - 1``.
    """
    device = frames.labels.device
    fill = _fill_by_numba if is_compiled(backend, device) else _fill_by_torch
    tables = torch.zeros(2, len(frames.target), *frames.shape, dtype=torch.int64, device=device)
    fill(frames, *tables.flatten(2))

    kept = slice(frames.num_classes)
    return tuple(tables[..., kept, kept])


def is_compiled(backend: str, device: torch.device) -> bool:
    """Says whether the compiled pass is to be taken. Raises `UserError` where it cannot be."""
    if backend not in BACKENDS:
        raise UserError(f"backend: {backend!r} is none of {', '.join(BACKENDS)}")
    if backend == "numba" and device.type != "cpu":
        raise UserError(f"backend: numba runs on the CPU, not on {device}; take auto or torch")
    return backend != "torch" and device.type == "cpu"


def _fill_by_torch(
    frames: Frames, count: Int64[Tensor, "b t"], penalty: Int64[Tensor, "b t"]
) -> None:
    codes = _encoded(frames).flatten(1)
    for n, code in enumerate(codes):
        cell = code
        if frames.bins is not None:
            cell = cell + CODES * frames.bins[n].index_select(0, frames.shell)
        if frames.marked is not None:
            cell = cell + CODES * frames.n_bins * frames.marked[n].flatten().to(torch.int32)
        count[n] = torch.bincount(cell, minlength=count.shape[1])

        wrong = torch.nonzero((code ^ (code >> 4)) & 15).squeeze(1)
        excess = frames.excess[n].index_select(0, frames.shell.index_select(0, wrong))
        penalty[n].scatter_add_(0, cell.index_select(0, wrong).long(), excess)


def _fill_by_numba(
    frames: Frames, count: Int64[Tensor, "b t"], penalty: Int64[Tensor, "b t"]
) -> None:
    # Only here: importing the compiler takes a second.
    from .kernels import count_frame

    shell, classes = frames.shell.numpy(), (frames.num_classes, frames.ignore_index)
    for n in range(len(frames.target)):
        ids = (_flat_ids(frames.labels[n]), _flat_ids(frames.target[n]))
        flags = (_flat(frames.mask, n), _flat(frames.marked, n))
        space = (shell, _flat(frames.bins, n), frames.n_bins, frames.excess[n].numpy())
        if not count_frame(*ids, *flags, *space, *classes, count[n].numpy(), penalty[n].numpy()):
            _encoded(frames)  # raises, naming what is wrong


def _encoded(frames: Frames) -> Tensor:
    ids = (frames.num_classes, frames.ignore_index)
    return encode(frames.labels, frames.target, frames.mask, *ids)


def _flat(tensors: Bool[Tensor, "b X Y Z"] | Sequence[Tensor] | None, n: int) -> np.ndarray | None:
    return None if tensors is None else tensors[n].reshape(-1).numpy()


def _flat_ids(ids: Int[Tensor, "X Y Z"]) -> np.ndarray:
    """Returns ids as numpy, of one of the two dtypes that are compiled."""
    if ids.dtype not in (torch.uint8, torch.int64):
        ids = ids.long()
    return ids.detach().reshape(-1).numpy()
