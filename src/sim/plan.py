"""The clips of a dataset, and whether its settings can be generated at all."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..data.rates import require_rates
from ..data.shards import share_of
from ..errors import UserError
from ..geometry import VoxelGrid
from .clip_maker import ClipMaker, ClipPlan
from .renderer import require_known
from .towns import builder_of
from .weather import Weather

# The least value of each number that has one.
AT_LEAST = {"seed": 0, "clips_per_town": 1, "town_seeds": 1}
AT_LEAST |= {"lidar_rays": 1, "camera_stride": 1, "range_m": 1}


def plan_clips(sim: Mapping) -> list[ClipPlan]:
    """Returns all clips of a dataset.

    The weathers take turns, from each town's last clip to the next town's first, so that they
    spread evenly over clips and towns (App. A.1).
    """
    check_settings(sim)

    plans = []
    for town in sim["towns"]:
        for index in range(sim["clips_per_town"]):
            weather = sim["weathers"][len(plans) % len(sim["weathers"])]
            plans.append(ClipPlan(f"{town}/clip{index:02d}", town, weather, index))
    return plans


def check_settings(sim: Mapping) -> None:
    """Refuses settings that cannot be generated, before any work starts."""
    for kind in ("weather", "town"):
        if not sim[f"{kind}s"]:
            raise UserError(f"sim.{kind}s: empty; name one {kind} or more")
    for name in sim["weathers"]:
        Weather.of(sim, name)
    for name in sim["towns"]:
        builder_of(name)

    if len(set(sim["towns"])) < len(sim["towns"]):
        raise UserError("sim.towns: a town is named twice; name each once")
    for key, least in AT_LEAST.items():
        if sim.get(key, least) < least:
            raise UserError(f"sim.{key}: {sim[key]} is too small; give {least} or more")
    require_rates(sim)

    if sim["workers"] is not None and sim["workers"] < 1:
        raise UserError("sim.workers: must be at least 1, or null for one per core")
    if not 0 < sim["image"]["hfov_deg"] < 180:
        raise UserError("sim.image.hfov_deg: must lie between 0 and 180; 90 is the design's")
    require_known(sim["renderer"])

    # Each of these refuses the keys that it reads.
    share_of((), sim["shard"], sim["shards"])
    _check_reach(VoxelGrid(**sim["grid"]), sim["range_m"])
    ClipMaker(sim, Path())


def _check_reach(grid: VoxelGrid, range_m: float) -> None:
    """Refuses a grid with corners that no sensor can reach."""
    corners_m = np.maximum(np.abs(grid.lower_m), np.abs(grid.upper_m))
    farthest_m = float(np.linalg.norm(corners_m))
    if not farthest_m <= range_m:  # NaN is no range
        raise UserError(
            f"grid.upper_m: a corner of the grid is {farthest_m:.1f} m from the UAV, and sensors "
            f"reach sim.range_m={range_m:g}; shrink the grid or give a range of "
            f"{np.ceil(farthest_m):.0f} or more"
        )
