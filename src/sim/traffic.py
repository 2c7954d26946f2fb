"""The moving actors of a clip, as plain data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ..errors import UserError
from .assets import ACTORS, extent_m
from .driver import drive
from .footprint import box_distance_m, boxes_overlap
from .layout import Town
from .pilot import STEP_S
from .placement import Placer
from .signals import SignalPlan, signal_plans
from .traveller import HABITS, Traveller

SizeOf = Callable[[str, int], tuple[float, float, float]]
"""As `size_of`."""


@dataclass(frozen=True)
class TrafficConfig:
    """How many actors of each type to place, and where. Raises `UserError` for unknown types."""

    counts: Mapping[str, int] = field(
        default_factory=lambda: {
            "car": 6,
            "truck": 2,
            "bus": 2,
            "pedestrian": 2,
            "bicycle": 3,
            "motorcycle": 4,
        }
    )
    near_m: float = 90.0
    """They start within this distance of somewhere on the flight."""
    seen_m: float = 45.0
    """They start where the flight will see most of them from within this distance."""
    uav_gap_m: float = 2.0
    """What would come nearer to the UAV is left out."""

    def __post_init__(self) -> None:
        for name in self.counts:
            if name not in HABITS:
                raise UserError(
                    f"sim.traffic.counts: no actor type {name!r}; there are {', '.join(HABITS)}"
                )


def size_of(actor_type: str, seed: int) -> tuple[float, float, float]:
    """Length, width and height in metres of the actor of a type that is drawn from a seed."""
    return extent_m(ACTORS[actor_type](np.random.default_rng(seed)))


@dataclass(frozen=True)
class Actor:
    """One actor at every step. Its origin is on the road or pavement under its middle; z is up, x
    forward.

    ``seed`` draws its appearance; ``size_m`` is length, width and height.
    """

    actor_id: int
    type: str
    seed: int
    size_m: tuple[float, float, float]
    position_m: Float[np.ndarray, "t 3"]
    yaw_rad: Float[np.ndarray, "t"]
    velocity_mps: Float[np.ndarray, "t 3"]


@dataclass(frozen=True)
class Traffic:
    """All actors of a clip, numbered from 1."""

    actors: tuple[Actor, ...]


def simulate_traffic(
    town: Town,
    rng: np.random.Generator,
    config: TrafficConfig,
    uav_m: Float[np.ndarray, "t 3"],
    size_of: SizeOf = size_of,
) -> Traffic:
    """Actors on the lanes and walks that the UAV sees from ``uav_m``, at each of its steps.

    There are fewer than asked for where the town has no room, or where one would come too near to
    the UAV or drive into another: then all others drive again without it, so that nobody reacts to
    what is not there.
    """
    plans = signal_plans(town, rng)
    placed = _placed(Placer(town, rng, uav_m, config.near_m, config.seen_m), rng, config, size_of)
    while placed:
        travellers, seeds = zip(*placed)
        actors = _driven(travellers, seeds, plans, town, len(uav_m))
        stays = _compatible(actors, uav_m, config.uav_gap_m)
        if all(stays):
            return Traffic(actors)
        placed = [each for each, keep in zip(placed, stays) if keep]
    return Traffic(())


def _placed(
    placer: Placer, rng: np.random.Generator, config: TrafficConfig, size_of: SizeOf
) -> list[tuple[Traveller, int]]:
    """Travellers and appearance seeds, the largest types first: they need the most room."""
    placed: list[tuple[Traveller, int]] = []
    for name in HABITS:
        for _ in range(config.counts.get(name, 0)):
            seed = int(rng.integers(2**31))
            others = [traveller for traveller, _ in placed]
            traveller = placer.place(name, size_of(name, seed), others)
            placed += [(traveller, seed)] if traveller else []
    return placed


def _driven(
    travellers: Sequence[Traveller],
    seeds: Sequence[int],
    plans: Mapping[int, SignalPlan],
    town: Town,
    steps: int,
) -> tuple[Actor, ...]:
    motion = drive(travellers, (steps - 1) * STEP_S, plans)
    arcs_m = motion.arc_at(np.arange(steps) * STEP_S)
    return tuple(
        replace(_actor(traveller, seed, arc_m, town), actor_id=k + 1)
        for k, (traveller, seed, arc_m) in enumerate(zip(travellers, seeds, arcs_m.T))
    )


def _actor(traveller: Traveller, seed: int, arc_m: Float[np.ndarray, "t"], town: Town) -> Actor:
    points_m, heading_rad = traveller.route.at(arc_m)
    rise_m = np.interp(arc_m, traveller.route.arc_m, traveller.route.rise_m)
    position_m = np.c_[points_m, town.terrain(points_m[:, 0], points_m[:, 1]) + rise_m]
    velocity_mps = np.gradient(position_m, STEP_S, axis=0)
    yaw_rad = (heading_rad + np.pi) % (2 * np.pi) - np.pi
    return Actor(0, traveller.type, seed, traveller.size_m, position_m, yaw_rad, velocity_mps)


def _compatible(
    actors: Sequence[Actor], uav_m: Float[np.ndarray, "t 3"], uav_gap_m: float
) -> list[bool]:
    """Which actors stay: no nearer to the UAV than that, and never in one that stays as well."""
    stays: list[bool] = []
    for actor in actors:
        distance_m = box_distance_m(uav_m, actor.position_m, actor.yaw_rad, actor.size_m)
        others = (other for other, kept in zip(actors, stays) if kept)
        met = any(_collide(actor, other) for other in others)
        stays.append(bool(distance_m.min() >= uav_gap_m) and not met)
    return stays


def _collide(one: Actor, other: Actor) -> bool:
    boxes = [(each.position_m[:, :2], each.yaw_rad, each.size_m[:2]) for each in (one, other)]
    return bool(boxes_overlap(*boxes[0], *boxes[1]).any())
