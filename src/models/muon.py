"""Muon: steps that are equally long in all directions of a matrix (Jordan et al. 2024)."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor
from torch.optim import AdamW

MOMENTUM = 0.95
# Root mean square of a step, in learning rates: twice that of AdamW, so one rate serves both.
STEP_RMS = 0.4
# The Polar Express (Amsel et al. 2025): a s + b s^3 + c s^5, one after the other, takes a singular
# value s from 0.001 to 1 to nearly 1. What is smaller is noise, and is not blown up to 1.
QUINTICS = (
    (8.28721201814563, -23.595886519098837, 17.300387312530933),
    (4.107059111542203, -2.9478499167379106, 0.5448431082926601),
    (3.9486908534822946, -2.908902115962949, 0.5518191394370137),
    (3.3184196573706015, -2.488488024314874, 0.51004894012372),
    (2.300652019954817, -1.6689039845747493, 0.4188073119525673),
    (1.891301407787398, -1.2679958271945868, 0.37680408948524835),
    (1.8750014808534479, -1.2500016453999487, 0.3750001645474248),
)


class Muon(AdamW):
    """AdamW, but for matrices and kernels, which move along `orthogonal` of their momentum.

    The gradient of a matrix is dominated by few directions, and AdamW hardly learns along the
    others. A kernel is the matrix of its outputs and all else. Vectors, and tensors of three axes
    (a map of queries), stay with AdamW. Takes the arguments of AdamW.
    """

    @torch.no_grad()
    def step(self, closure: Callable[[], Tensor] | None = None) -> Tensor | None:
        """Moves all parameters by one step, and returns what the closure returns."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()

        for group in self.param_groups:
            lr = group["lr"]
            matrices = [p for p in group["params"] if p.grad is not None and p.ndim in (2, 4)]
            directions = orthogonal([self._ahead(matrix).flatten(1) for matrix in matrices])
            for matrix, direction in zip(matrices, directions):
                scale = STEP_RMS * math.sqrt(max(direction.shape))
                matrix.mul_(1 - lr * group["weight_decay"])
                matrix.add_(direction.view_as(matrix), alpha=-lr * scale)
                matrix.grad = None  # AdamW passes over what has no gradient
        super().step()
        return loss

    def _ahead(self, parameter: Tensor) -> Tensor:
        """Returns the direction of the gradient and its momentum (Nesterov)."""
        state = self.state[parameter]
        if not state:
            # AdamW asks every state for its number of steps when it is read from a checkpoint.
            state |= {"step": torch.zeros(()), "momentum": torch.zeros_like(parameter)}
        state["step"] += 1
        momentum = state["momentum"].lerp_(parameter.grad, 1 - MOMENTUM)
        return parameter.grad.lerp(momentum, MOMENTUM)


def orthogonal(matrices: Sequence[Float[Tensor, "_ _"]]) -> list[Float[Tensor, "_ _"]]:
    """Returns ``U V'`` of every matrix's singular value decomposition ``U S V'``: of all matrices
    with orthonormal rows or columns the nearest one. Zeros stay zeros.

    It is ``(M M')^(-1/2) M``, from the smaller side and by products alone: a GPU would take longer
    to decompose the matrices than for all the rest of a step.
    """
    # To ask whether a matrix is all zeros would make the host wait for a GPU.
    units = [matrix / matrix.norm().clamp(min=torch.finfo().tiny) for matrix in matrices]
    squares = [unit.T @ unit if unit.shape[0] > unit.shape[1] else unit @ unit.T for unit in units]

    of_size = defaultdict(list)
    for index, square in enumerate(squares):
        of_size[len(square)].append(index)
    for same in of_size.values():
        whitenings = inverse_root(torch.stack([squares[index] for index in same]))
        for index, whitening in zip(same, whitenings):
            unit = units[index]
            is_tall = unit.shape[0] > unit.shape[1]
            units[index] = unit @ whitening if is_tall else whitening @ unit
    return units


def inverse_root(square: Float[Tensor, "b n n"]) -> Float[Tensor, "b n n"]:
    """Returns the matrices to the power of -1/2, of symmetric ones with eigenvalues from 0 to 1.

    Below 1e-6 the factor stays at that of `QUINTICS` for the smallest, some 3,600.
    """
    root = torch.eye(square.shape[-1], device=square.device)
    for a, b, c in QUINTICS:
        factor = torch.baddbmm(square, square, square, beta=b, alpha=c)
        factor.diagonal(dim1=-2, dim2=-1).add_(a)
        root, square = factor @ root, factor @ square @ factor
    return root
