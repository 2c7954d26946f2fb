"""The moving actors of a clip, as plain data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ..errors import UserError
from ..ontology import ACTOR_TYPES
from .actor import HABITS, Actor
from .assets import ACTORS, extent_m
from .driver import drive
from .footprint import Footprint, box_distance_m, boxes_overlap
from .layout import Town
from .lights import LightPlan, light_plans
from .pilot import STEP_S
from .placement import Placer, Size
from .scene import SceneActor, parts_of

# An actor's place and direction at every step.
Track = tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "t"]]

COUNTS = {"car": 6, "truck": 2, "bus": 2, "pedestrian": 2, "bicycle": 3, "motorcycle": 4}


@dataclass(frozen=True)
class TrafficConfig:
    """The number of actors of each type, and where they start.

    Raises `UserError` for unknown types.
    """

    counts: Mapping[str, int] = field(default_factory=COUNTS.copy)
    # They start within this distance of somewhere on the flight.
    near_m: float = 90.0
    # They start where the flight will see most of them from within this distance.
    seen_m: float = 45.0
    # An actor that would come nearer to the UAV is left out.
    uav_gap_m: float = 2.0

    def __post_init__(self) -> None:
        for name in self.counts:
            if name not in HABITS:
                raise UserError(
                    f"sim.traffic.counts: no actor type {name!r}; there are {', '.join(HABITS)}"
                )


def size_of(actor_type: str, seed: int) -> Size:
    """Returns length, width and height in metres of the actor that is drawn from a seed."""
    return extent_m(ACTORS[actor_type](np.random.default_rng(seed)))


def simulate_traffic(
    town: Town, rng: np.random.Generator, config: TrafficConfig, uav_m: Float[np.ndarray, "t 3"]
) -> tuple[SceneActor, ...]:
    """Drives actors on the lanes and walks that the UAV sees from ``uav_m``, at each of its steps.

    They are numbered from 1. There are fewer than asked for where the town has no room, or where
    one would come too near to the UAV or drive into another.
    """
    plans = light_plans(town, rng)
    placed = _placed(Placer(town, rng, uav_m, config.near_m, config.seen_m), rng, config)

    # Where one is left out all others drive again, so that none reacts to what is not there.
    while placed:
        tracks = _tracks(placed, plans, town, len(uav_m))
        stays = _compatible(placed, tracks, uav_m, config.uav_gap_m)
        if all(stays):
            numbered = enumerate(zip(placed, tracks), start=1)
            return tuple(_scene_actor(number, *driven) for number, driven in numbered)
        placed = [actor for actor, keep in zip(placed, stays) if keep]
    return ()


def _placed(placer: Placer, rng: np.random.Generator, config: TrafficConfig) -> list[Actor]:
    """Places actors, the largest types first."""
    placed: list[Actor] = []
    for name in HABITS:
        for _ in range(config.counts.get(name, 0)):
            seed = int(rng.integers(2**31))
            actor = placer.place(name, size_of(name, seed), placed)
            if actor is not None:
                placed.append(replace(actor, seed=seed))
    return placed


def _tracks(
    placed: Sequence[Actor], plans: Mapping[int, LightPlan], town: Town, steps: int
) -> list[Track]:
    """Drives placed actors, and returns the place and direction of each at every step."""
    motion = drive(placed, (steps - 1) * STEP_S, plans)
    arcs_m = motion.arc_at(np.arange(steps) * STEP_S)

    tracks = []
    for actor, arc_m in zip(placed, arcs_m.T):
        points_m, heading_rad = actor.route.at(arc_m)
        rise_m = np.interp(arc_m, actor.route.arc_m, actor.route.rise_m)
        position_m = np.c_[points_m, town.terrain(points_m[:, 0], points_m[:, 1]) + rise_m]
        tracks.append((position_m, (heading_rad + np.pi) % (2 * np.pi) - np.pi))
    return tracks


def _compatible(
    placed: Sequence[Actor],
    tracks: Sequence[Track],
    uav_m: Float[np.ndarray, "t 3"],
    uav_gap_m: float,
) -> list[bool]:
    """Returns which actors stay: not too near to the UAV, and never in one that stays as well."""
    stays: list[bool] = []
    footprints: list[Footprint] = []
    for actor, (position_m, yaw_rad) in zip(placed, tracks):
        footprint = position_m[:, :2], yaw_rad, actor.size_m[:2]
        distance_m = box_distance_m(uav_m, position_m, yaw_rad, actor.size_m)
        collides = any(boxes_overlap(footprint, other).any() for other in footprints)
        stays.append(bool(distance_m.min() >= uav_gap_m) and not collides)
        if stays[-1]:
            footprints.append(footprint)
    return stays


def _scene_actor(number: int, actor: Actor, track: Track) -> SceneActor:
    """Gives a driven actor its shape, drawn from its own seed."""
    position_m, yaw_rad = track
    return SceneActor(
        actor_id=number,
        type=actor.type,
        class_id=ACTOR_TYPES[actor.type],
        size_m=actor.size_m,
        parts=parts_of(ACTORS[actor.type](np.random.default_rng(actor.seed))),
        position_m=position_m,
        yaw_rad=yaw_rad,
        velocity_mps=np.gradient(position_m, STEP_S, axis=0),
    )
