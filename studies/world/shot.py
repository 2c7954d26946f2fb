"""Shots of the simulated world: towns from above and from the UAV, under any weather.

Everything comes from the ``sim`` configuration and its seed, as the clips do; only the picture's
size is chosen for print.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from src.geometry import front_mount, pinhole, rigid, rotation_from_euler
from src.sim.air import apply_weather
from src.sim.camera import FAR_M, NEAR_M
from src.sim.clip_maker import ClipMaker, ClipPlan
from src.sim.pilot import STEP_HZ
from src.sim.scene import Scene
from src.sim.staging import generator_for, place_of
from src.sim.weather import Weather
from src.sim.world import World

SIZE_PIX = (960, 544)

# Size of the pictures among which `street_shot` chooses, one for every second of the flight.
PREVIEW_PIX = (96, 64)

AERIAL_HFOV_RAD, AERIAL_PITCH_RAD = math.radians(46), math.radians(38)
AERIAL_YAW_RAD = math.radians(60)

# Of the aerial camera from the middle of the town, in diagonals of what can be flown through.
AERIAL_DISTANCE = 1.25

AERIAL_DEPTH_RANGE_M = (10.0, 900.0)


@dataclass(frozen=True)
class Shot:
    """A scene at a step, and the camera that looks at it."""

    scene: Scene
    step: int
    world_from_camera: Float[Tensor, "4 4"]
    pix_from_camera: Float[Tensor, "3 3"]
    depth_range_m: tuple[float, float] = (NEAR_M, FAR_M)


def aerial_shot(sim: Mapping, town: str) -> Shot:
    """A whole town from above, obliquely; without moving actors. Raises `UserError`."""
    place = place_of(town, sim["seed"])
    points_m = np.concatenate([path.points_m for path in place.town.corridors])
    lower_m, upper_m = points_m.min(axis=0), points_m.max(axis=0)
    angles = torch.tensor([0.0, AERIAL_PITCH_RAD, AERIAL_YAW_RAD], dtype=torch.float64)
    rotation = rotation_from_euler(*angles) @ front_mount((0.0, 0.0, 0.0))[:3, :3]
    # The camera looks at the middle of the corridors, from a distance that fits them.
    middle_m = torch.tensor([*(lower_m + upper_m) / 2, 0.0], dtype=torch.float64)
    away_m = AERIAL_DISTANCE * float(np.linalg.norm(upper_m - lower_m))
    world_from_camera = rigid(rotation, middle_m - away_m * rotation[:, 2])
    lens = pinhole(*SIZE_PIX, AERIAL_HFOV_RAD)
    return Shot(place.whole, 0, world_from_camera, lens, AERIAL_DEPTH_RANGE_M)


def street_shot(sim: Mapping, town: str) -> Shot:
    """The front camera's view at the richest second of the town's first flight.

    The richest is the one whose pixels are spread most evenly over the classes. Raises `UserError`.
    """
    maker = ClipMaker(sim, Path())
    flight, scene = maker.stage(ClipPlan(f"{town}/clip00", town, "cloudy", 0))
    world_from_camera = torch.from_numpy(flight.world_from_body) @ maker.body_from_camera
    hfov_rad = math.radians(sim["image"]["hfov_deg"])
    steps, cloudy = range(0, len(world_from_camera), STEP_HZ), Weather.of(sim, "cloudy")

    with World(scene, pinhole(*PREVIEW_PIX, hfov_rad), *PREVIEW_PIX) as world:
        previews = (world.render(step, world_from_camera[step], cloudy) for step in steps)
        richest = steps[int(np.argmax([entropy(preview.class_id) for preview in previews]))]

    return Shot(scene, richest, world_from_camera[richest], pinhole(*SIZE_PIX, hfov_rad))


def entropy(class_id: UInt8[np.ndarray, "h w"]) -> float:
    """Shannon entropy, in nats, of the classes of an image's pixels; the sky counts as one."""
    counts = np.unique(class_id, return_counts=True)[1]
    share = counts / class_id.size
    return float(-(share * np.log(share)).sum())


def photograph(
    shot: Shot, weathers: Iterable[str], sim: Mapping
) -> dict[str, UInt8[np.ndarray, "h w 3"]]:
    """The picture of a shot under each weather. Raises `UserError` for an unknown one."""
    pictures = {}
    matrices = shot.world_from_camera, shot.pix_from_camera

    with World(
        shot.scene, shot.pix_from_camera, *SIZE_PIX, depth_range_m=shot.depth_range_m
    ) as world:
        for name in weathers:
            weather = Weather.of(sim, name)
            rendering = world.render(shot.step, shot.world_from_camera, weather)
            rng = generator_for(sim["seed"], "portrait", name)
            pictures[name] = apply_weather(rendering, *matrices, weather, rng)

    return pictures
