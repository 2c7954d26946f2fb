"""Calibrated logits: scaled and shifted so that a probability is a frequency on validation."""

from collections.abc import Mapping
from typing import Literal, get_args

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_choice
from ..ontology import NUM_CLASSES
from .tensors import Logits, Scalar

Kind = Literal["temperature", "vector", "distance"]

# Between these distances from the UAV, numbers that change with it change linearly.
KNOTS_M = (2.0, 5.0, 10.0, 20.0, 40.0)
# Pull of every number towards no change: it decides where validation says nothing.
PRIOR = 1e-4


class Calibrator(nn.Module):
    """Maps the logits of a voxel to ``scale * logits + shift`` (Guo et al., 2017).

    ``"temperature"`` has one scale and no shift, ``"vector"`` a scale and a shift for each class,
    and ``"distance"`` these at each of some distances from the UAV, linear in between. ``scale``
    and ``shift`` [distances, 9] are what `fitted` found. Raises `UserError` for what is not finite.
    """

    def __init__(self, grid: VoxelGrid, kind: Kind, scale: list, shift: list) -> None:
        super().__init__()
        at_knots = torch.tensor([scale, shift], dtype=torch.float64)
        if not at_knots.isfinite().all():
            raise UserError("calibration: holds numbers that are not finite; run task=calibrate")
        shares = shares_of(kind, grid.centers(torch.float64).norm(dim=-1))
        scale, shift = torch.einsum("nkc,xyzk->ncxyz", at_knots, shares).float()
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("shift", shift, persistent=False)

    @classmethod
    def of(cls, grid: VoxelGrid, facts: Mapping) -> "Calibrator":
        """Builds what `fitted` returned."""
        return cls(grid, facts["kind"], facts["scale"], facts["shift"])

    def forward(self, logits: Logits) -> Logits:
        """Returns calibrated logits, in float32."""
        return self.scale * logits.float() + self.shift


def shares_of(kind: Kind, distance_m: Float[Tensor, "*n"]) -> Float[Tensor, "*n knots"]:
    """Returns how much each distance of the numbers counts at a distance from the UAV."""
    require_choice("calibration.kind", kind, get_args(Kind))
    if kind != "distance":
        return torch.ones_like(distance_m)[..., None]
    knots_m = torch.tensor(KNOTS_M, dtype=distance_m.dtype)
    place = torch.bucketize(distance_m, knots_m).clamp(1, len(knots_m) - 1)
    low, high = knots_m[place - 1], knots_m[place]
    share = ((distance_m - low) / (high - low)).clamp(0, 1)[..., None]
    first, second = (nn.functional.one_hot(each, len(knots_m)) for each in (place - 1, place))
    return first * (1 - share) + second * share


def fitted(
    kind: Kind,
    logits: Float[Tensor, "n 9"],
    target: Int64[Tensor, "n"],
    distance_m: Float[Tensor, "n"],
) -> dict:
    """Returns the arguments of the `Calibrator` with the least NLL of these voxels, as plain data.

    The NLL is convex in all of its numbers, so there is one answer. Raises `UserError` for no
    voxel, and for logits that are not finite.
    """
    if not len(logits):
        raise UserError("calibration: validation has no known voxel; give data with val_clips")
    if not logits.isfinite().all():
        raise UserError("calibration: the logits hold NaN or infinities; look at the network")

    logits, shares = logits.double(), shares_of(kind, distance_m.double())
    knots = shares.shape[1]
    free = torch.zeros(knots, 1 if kind == "temperature" else 2 * NUM_CLASSES, dtype=torch.float64)
    free.requires_grad_()

    def numbers() -> tuple[Tensor, Tensor]:
        if kind == "temperature":
            return (1 + free).expand(knots, NUM_CLASSES), torch.zeros(knots, NUM_CLASSES).double()
        return 1 + free[:, :NUM_CLASSES], free[:, NUM_CLASSES:]

    optimizer = torch.optim.LBFGS([free], max_iter=300, line_search_fn="strong_wolfe")

    def loss() -> Scalar:
        optimizer.zero_grad()
        scale, shift = (shares @ each for each in numbers())
        nll = cross_entropy(scale * logits + shift, target) + PRIOR * free.square().sum()
        nll.backward()
        return nll

    optimizer.step(loss)
    scale, shift = (each.detach().tolist() for each in numbers())
    return {"kind": kind, "scale": scale, "shift": shift}
