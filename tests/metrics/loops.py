"""KAR-IoU and its parts written out as plain loops over voxels, from App. A.4 of the paper."""

import math
from collections import namedtuple
from itertools import product

from tests.metrics.inputs import mean

PAPER = {"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0}
OTHER = {"horizon_s": 1.5, "decay_per_s": 0.1, "penalty_scale": 7.0, "min_speed_mps": 9.0}

Voxel = namedtuple("Voxel", "true predicted excess ttc_s distance_m seen")
"""One counted voxel; ``excess`` is what is added to the weight 1 of an error there."""


def counted_voxels(grid, batch, visible=None, parameters=PAPER):
    preds, target, velocity = batch
    voxels = []
    for b, x, y, z in product(range(len(target)), *map(range, grid.shape)):
        true = int(target[b, x, y, z])
        if true == 255:
            continue

        center_m = [low + (i + 0.5) * grid.voxel_m for low, i in zip(grid.lower_m, (x, y, z))]
        distance_m = math.sqrt(sum(c * c for c in center_m))
        speed_mps = math.sqrt(sum(v * v for v in velocity[b].tolist()))
        ttc_s = distance_m / max(speed_mps, parameters["min_speed_mps"])

        excess = parameters["penalty_scale"] * math.exp(-parameters["decay_per_s"] * ttc_s)
        if ttc_s > parameters["horizon_s"]:
            excess = 0.0
        seen = visible is not None and bool(visible[b, x, y, z])
        voxels.append(Voxel(true, int(preds[b, x, y, z]), excess, ttc_s, distance_m, seen))
    return voxels


def class_shares(voxels, missed=None, phantom=None):
    """TP / (TP + FN + FP) of all nine classes, NaN where a class has none of them.

    Errors weigh 1 + factor * excess, ``missed`` being the factor of false negatives and
    ``phantom`` that of false positives; None leaves that kind out.
    """
    shares = []
    for c in range(9):
        hits = sum(v.true == v.predicted == c for v in voxels)
        whole = float(hits)
        for v in voxels:
            if v.true == v.predicted:
                continue
            if v.true == c and missed is not None:
                whole += 1 + missed * v.excess
            if v.predicted == c and phantom is not None:
                whole += 1 + phantom * v.excess
        shares.append(hits / whole if whole else math.nan)
    return shares


def occupied_mean(shares):
    """Mean over the classes that are there, free space left out."""
    return mean(shares[:8])
