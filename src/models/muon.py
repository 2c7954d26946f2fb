"""Muon: steps that are equally long in all directions of a matrix (Jordan et al. 2024)."""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor
from torch.optim import AdamW

MOMENTUM = 0.95
# Root mean square of a step, in learning rates: twice that of AdamW, so one rate serves both.
STEP_RMS = 0.4
# Shares of the sum of squared singular values; what is smaller is noise, and is not blown up.
FLOOR = 1e-7


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
            for parameter in group["params"]:
                if parameter.grad is not None and parameter.ndim in (2, 4):
                    self._move(parameter, group["lr"], group["weight_decay"])
                    parameter.grad = None  # AdamW passes over what has no gradient
        super().step()
        return loss

    def _move(self, parameter: Tensor, lr: float, weight_decay: float) -> None:
        state = self.state[parameter]
        if not state:
            # AdamW asks every state for its number of steps when it is read from a checkpoint.
            state |= {"step": torch.zeros(()), "momentum": torch.zeros_like(parameter)}
        state["step"] += 1

        momentum = state["momentum"].lerp_(parameter.grad, 1 - MOMENTUM)
        ahead = parameter.grad.lerp(momentum, MOMENTUM).flatten(1)
        scale = STEP_RMS * math.sqrt(max(ahead.shape))
        parameter.mul_(1 - lr * weight_decay)
        parameter.add_(orthogonal(ahead).view_as(parameter), alpha=-lr * scale)


def orthogonal(matrix: Float[Tensor, "m n"]) -> Float[Tensor, "m n"]:
    """Returns ``U V'`` of the singular value decomposition ``U S V'``: of all matrices with
    orthonormal rows or columns the nearest one.

    It is computed as ``(M M')^(-1/2) M``, from the smaller side. Zeros stay zeros.
    """
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonal(matrix.T).T

    # To ask whether it is all zeros would make the host wait for a GPU.
    unit = matrix / matrix.norm().clamp(min=torch.finfo(matrix.dtype).tiny)
    squares, vectors = torch.linalg.eigh(unit @ unit.T)
    whitening = (vectors * squares.clamp(min=FLOOR).rsqrt()) @ vectors.T
    return whitening @ unit
