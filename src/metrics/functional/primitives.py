"""Motion primitives: short paths that a UAV could fly next, and what stands in them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int64, UInt8
from torch import Tensor

from ...errors import UserError
from ...geometry import VoxelGrid
from .codes import NOTHING


def primitive_paths(
    velocity_mps: Float[Tensor, "3"],
    speed_mps: float,
    turns_deg_per_s: Sequence[float],
    climbs_deg: Sequence[float],
    seconds: float,
    step_m: float,
) -> Float64[np.ndarray, "k n 3"]:
    """Returns points at most ``step_m`` apart on every path, in the occ frame, in metres.

    A path begins at the UAV in the direction of its velocity in the plane, or ahead where it has
    none. It has a steady speed, climb angle and turn rate (to the left); with no turn it is
    straight.
    """
    times_s = np.linspace(0.0, seconds, max(2, math.ceil(speed_mps * seconds / step_m) + 1))
    climb, turn = np.meshgrid(np.radians(climbs_deg), np.radians(turns_deg_per_s), indexing="ij")
    climb, turn = climb.reshape(-1, 1), turn.reshape(-1, 1)
    heading = math.atan2(float(velocity_mps[1]), float(velocity_mps[0]))

    # A chord of an arc points halfway between its ends; sinc is its length as a share of the arc's.
    half = turn * times_s / 2
    along_m = speed_mps * times_s * np.cos(climb) * np.sinc(half / np.pi)
    height_m = speed_mps * times_s * np.sin(climb)
    return np.stack(
        [along_m * np.cos(heading + half), along_m * np.sin(heading + half), height_m], axis=-1
    )


class Swept(NamedTuple):
    """The voxels within a radius of each path. ``met`` is the true class of the first occupied one
    along the path, or `NOTHING`; ``known`` says whether any of them has a label, ``said`` whether
    any is predicted occupied, and ``log_odds`` is their highest log-odds of occupied, if there are
    logits."""

    met: Int64[Tensor, "k"]
    known: Bool[Tensor, "k"]
    said: Bool[Tensor, "k"]
    log_odds: Float64[Tensor, "k"]


def swept(
    codes: UInt8[Tensor, "X Y Z"],
    logits: Float[Tensor, "c X Y Z"] | None,
    paths_m: Float64[np.ndarray, "k n 3"],
    radius_m: float,
    grid: VoxelGrid,
    free_index: int,
) -> Swept:
    """Returns the voxels that each path of `primitive_paths` sweeps, on the CPU.

    ``codes`` are those of `encode`; voxels that it does not count are passed over. A voxel is swept
    whose center is within the radius of a point of the path. Raises `UserError` for logits that
    hold infinities.
    """
    # Only here: importing the compiler takes a second.
    from .kernels import sweep

    count = len(paths_m)
    met, known, said = (np.full(count, value, np.uint8) for value in (NOTHING, 0, 0))
    log_odds = np.full(count, -np.inf)
    # In voxels; the center of voxel 0 is at 0.
    paths = (paths_m - np.array(grid.lower_m)) / grid.voxel_m - 0.5
    radius = radius_m / grid.voxel_m
    scores = None if logits is None else logits.detach().float().cpu().contiguous().numpy()
    seen = codes.cpu().contiguous().numpy()
    # A point may be half a voxel nearer along each axis than the center of its voxel.
    ball = within(radius, 0.5)
    sweep(seen, scores, paths, ball, radius, free_index, met, known, said, log_odds)
    if np.isnan(log_odds).any():
        raise UserError("preds: the logits hold infinities; look for a loss that diverged")
    tensors = map(torch.from_numpy, (met.astype(np.int64), known > 0, said > 0, log_odds))
    return Swept(*tensors)


def within(radius: float, nearer: float = 0.0) -> Int64[np.ndarray, "m 3"]:
    """Returns all offsets within a radius, in voxels, where each axis may be so much ``nearer``."""
    reach = math.ceil(radius + nearer)
    sides = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(sides, sides, sides, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = np.maximum(np.abs(offsets) - nearer, 0.0)
    return offsets[(nearest**2).sum(-1) <= radius**2 + 1e-9]
