"""The moving actors of a clip, as plain data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ..errors import UserError
from .actor import HABITS, Actor
from .assets import ACTORS, extent_m, upright
from .driver import drive
from .footprint import Footprint, box_distance_m, boxes_overlap
from .layout import Town
from .lights import LightPlan, light_plans
from .pilot import STEP_S
from .placement import Placer, Size

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


@dataclass(frozen=True)
class ActorTrack:
    """One actor at every step: its place, direction and velocity.

    Its origin is on the road or pavement under its middle; z is up, x forward. ``seed`` draws its
    appearance; ``size_m`` is length, width and height.
    """

    actor_id: int
    type: str
    seed: int
    size_m: Size
    position_m: Float[np.ndarray, "t 3"]
    yaw_rad: Float[np.ndarray, "t"]
    velocity_mps: Float[np.ndarray, "t 3"]

    @property
    def footprint(self) -> Footprint:
        """What the actor covers of the ground at every step."""
        return self.position_m[:, :2], self.yaw_rad, self.size_m[:2]

    @property
    def world_from_actor(self) -> Float[np.ndarray, "t 4 4"]:
        """The transform at every step, of an actor that stands upright on its place."""
        places = zip(self.position_m, self.yaw_rad)
        return np.stack([upright(*position_m, yaw_rad) for position_m, yaw_rad in places])


def simulate_traffic(
    town: Town, rng: np.random.Generator, config: TrafficConfig, uav_m: Float[np.ndarray, "t 3"]
) -> tuple[ActorTrack, ...]:
    """Drives actors on the lanes and walks that the UAV sees from ``uav_m``, at each of its steps.

    They are numbered from 1. There are fewer than asked for where the town has no room, or where
    one would come too near to the UAV or drive into another.
    """
    plans = light_plans(town, rng)
    placed = _placed(Placer(town, rng, uav_m, config.near_m, config.seen_m), rng, config)

    # Where one is left out all others drive again, so that none reacts to what is not there.
    while placed:
        tracks = _tracks(placed, plans, town, len(uav_m))
        stays = _compatible(tracks, uav_m, config.uav_gap_m)
        if all(stays):
            return tracks
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
) -> tuple[ActorTrack, ...]:
    """Drives placed actors, and returns where each is at every step."""
    motion = drive(placed, (steps - 1) * STEP_S, plans)
    arcs_m = motion.arc_at(np.arange(steps) * STEP_S)

    tracks = []
    for actor, arc_m in zip(placed, arcs_m.T):
        points_m, heading_rad = actor.route.at(arc_m)
        rise_m = np.interp(arc_m, actor.route.arc_m, actor.route.rise_m)
        position_m = np.c_[points_m, town.terrain(points_m[:, 0], points_m[:, 1]) + rise_m]
        track = ActorTrack(
            actor_id=len(tracks) + 1,
            type=actor.type,
            seed=actor.seed,
            size_m=actor.size_m,
            position_m=position_m,
            yaw_rad=(heading_rad + np.pi) % (2 * np.pi) - np.pi,
            velocity_mps=np.gradient(position_m, STEP_S, axis=0),
        )
        tracks.append(track)
    return tuple(tracks)


def _compatible(
    tracks: Sequence[ActorTrack], uav_m: Float[np.ndarray, "t 3"], uav_gap_m: float
) -> list[bool]:
    """Returns which actors stay: not too near to the UAV, and never in one that stays as well."""
    stays: list[bool] = []
    for track in tracks:
        distance_m = box_distance_m(uav_m, track.position_m, track.yaw_rad, track.size_m)
        others = (other for other, kept in zip(tracks, stays) if kept)
        collides = any(boxes_overlap(track.footprint, other.footprint).any() for other in others)
        stays.append(bool(distance_m.min() >= uav_gap_m) and not collides)
    return stays
