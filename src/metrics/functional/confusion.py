"""A batch as counts [target, prediction], for every frame and part of space.

Row c off the diagonal holds the false negatives of class c, column c its false
positives. There are two: how many voxels, and the sum of their excess penalties. On the CPU one
compiled pass makes them, elsewhere and on request plain torch, to the same bits.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Int, Int64, UInt8
from torch import Tensor

from ...errors import UserError
from .codes import CODES

BACKENDS = ("auto", "numba", "torch")


def confusion_counts(
    codes: UInt8[Tensor, "b X Y Z"],
    shell: Int[Tensor, "v"],
    excess: Sequence[Int64[Tensor, "s"]],
    parts: Sequence[Int[Tensor, "v"] | None],
    num_parts: int,
    num_classes: int,
    backend: str = "auto",
) -> tuple[Int64[Tensor, "b k c c"], Int64[Tensor, "b k c c"]]:
    """Returns voxel counts and excess penalties of every frame, sorted by part (k).

    ``codes`` are those of `encode`. ``shell`` names each voxel's distance from the UAV, and
    ``excess`` is what an error at each distance weighs more than 1 (`Penalty.excess_table`).
    ``parts`` says in which of ``num_parts`` parts of space each voxel of a frame lies; with
    ``None`` all of them lie in the first.
    """
    compiled = is_compiled(backend, codes.device)
    if compiled:
        from .kernels import count_frame  # only here: importing the compiler takes a second

    counts = torch.zeros(2, len(codes), num_parts * CODES, dtype=torch.int64, device=codes.device)
    for n, frame in enumerate(zip(codes.flatten(1), parts)):
        tensors = (*frame, shell, excess[n], *counts[:, n])
        if compiled:
            count_frame(*(None if tensor is None else tensor.numpy() for tensor in tensors))
        else:
            _count_frame_by_torch(*tensors)

    kept = slice(num_classes)
    return tuple(counts.unflatten(-1, (num_parts, 16, 16))[..., kept, kept])


def is_compiled(backend: str, device: torch.device) -> bool:
    """Says whether the compiled pass is to be taken. Raises `UserError` where it cannot be."""
    if backend not in BACKENDS:
        raise UserError(f"backend: {backend!r} is none of {', '.join(BACKENDS)}")
    if backend == "numba" and device.type != "cpu":
        raise UserError(f"backend: numba runs on the CPU, not on {device}; take auto or torch")
    return backend != "torch" and device.type == "cpu"


def _count_frame_by_torch(codes, parts, shell, excess, count, penalty) -> None:
    """Does in plain operations what `kernels.count_frame` does in one compiled pass."""
    cells = codes if parts is None else codes + CODES * parts
    count += torch.bincount(cells, minlength=len(count))

    wrong = torch.nonzero((codes ^ (codes >> 4)) & 15).squeeze(1)
    of_errors = excess.index_select(0, shell.index_select(0, wrong))
    penalty.scatter_add_(0, cells.index_select(0, wrong).long(), of_errors)
