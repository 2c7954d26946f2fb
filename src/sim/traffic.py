"""The moving actors of a clip, as plain data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from ..errors import UserError
from .assets import ACTORS, extent_m
from .driver import HABITS, Traveller, drive
from .layout import Path, Town
from .pilot import STEP_S
from .route import Route, chain

START_GAP_M = 1.5
TRIES = 20
WALKERS = {"pedestrian": 1.0, "bicycle": 0.3}
"""Share of each type that keeps to the walks; everyone else takes the lanes."""

SizeOf = Callable[[str, int], tuple[float, float, float]]
"""As `size_of`."""


@dataclass(frozen=True)
class TrafficConfig:
    """How many actors of each type to place, and where. Raises `UserError` for unknown types."""

    counts: Mapping[str, int] = field(
        default_factory=lambda: {
            "car": 12,
            "truck": 4,
            "bus": 3,
            "pedestrian": 14,
            "bicycle": 8,
            "motorcycle": 6,
        }
    )
    near_m: float = 55.0
    """They start within this distance of somewhere on the flight."""
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
    """Actors on the lanes and walks near the UAV's positions ``uav_m``, at each of its steps.

    There are fewer than asked for where the town has no room, or where one would come too near to
    the UAV or drive into another.
    """
    duration_s = (len(uav_m) - 1) * STEP_S
    placed = _place(town, rng, config, uav_m, size_of, duration_s)
    if not placed:
        return Traffic(())
    travellers, seeds = zip(*placed)
    arcs_m = drive(travellers, duration_s).arc_at(np.arange(len(uav_m)) * STEP_S)
    actors = [
        _actor(traveller, seed, arc_m, town)
        for traveller, seed, arc_m in zip(travellers, seeds, arcs_m.T)
    ]
    kept: list[Actor] = []
    for actor in actors:
        distance_m = _distance_m(actor, uav_m).min()
        if distance_m >= config.uav_gap_m and not any(_collide(actor, other) for other in kept):
            kept.append(replace(actor, actor_id=len(kept) + 1))
    return Traffic(tuple(kept))


# -------------------------------------------------------------------------------------- placement


def _place(
    town: Town,
    rng: np.random.Generator,
    config: TrafficConfig,
    uav_m: Float[np.ndarray, "t 3"],
    size_of: SizeOf,
    duration_s: float,
) -> list[tuple[Traveller, int]]:
    """Travellers and appearance seeds, the largest types first, none overlapping another."""
    way_m = uav_m[:: max(len(uav_m) // 24, 1), :2]
    spots = {ways: _spots(getattr(town, ways), way_m, config.near_m) for ways in ("lanes", "walks")}
    placed: list[tuple[Traveller, int]] = []
    for name in (kind for kind in HABITS for _ in range(config.counts.get(kind, 0))):
        ways = "walks" if rng.random() < WALKERS.get(name, 0.0) else "lanes"
        seed = int(rng.integers(2**31))
        size_m = size_of(name, seed)
        for _ in range(TRIES if spots[ways] else 0):
            spot = spots[ways][int(rng.integers(len(spots[ways])))]
            traveller = _set_out(name, size_m, getattr(town, ways), spot, rng, duration_s)
            if traveller and not any(_crowded(traveller, other) for other, _ in placed):
                placed.append((traveller, seed))
                break
    return placed


def _spots(
    paths: tuple[Path, ...], way_m: Float[np.ndarray, "k 2"], near_m: float
) -> list[tuple[int, float]]:
    """Places (path, arc in metres) every 2 m along the paths, not far from the UAV's way."""
    spots = []
    for index, path in enumerate(paths):
        arc_m = np.r_[0, np.cumsum(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1))]
        at_m = np.arange(1.0, arc_m[-1], 2.0)
        points_m = np.stack([np.interp(at_m, arc_m, axis_m) for axis_m in path.points_m.T], axis=1)
        apart_m = np.linalg.norm(points_m[:, None] - way_m[None], axis=-1)
        spots += [(index, float(arc)) for arc in at_m[(apart_m < near_m).any(axis=1)]]
    return spots


def _set_out(
    name: str,
    size_m: tuple[float, float, float],
    paths: tuple[Path, ...],
    spot: tuple[int, float],
    rng: np.random.Generator,
    duration_s: float,
) -> Traveller | None:
    """Someone who starts at a spot; None where the way ends under the bumper."""
    index, start_m = spot
    start_m += rng.uniform(-1, 1)
    speed_mps = rng.uniform(*HABITS[name].speed_mps)
    indices = chain(paths, rng, index, start_m + speed_mps * duration_s + size_m[0] + 10)
    middle = Route.through(paths, indices, HABITS[name].corner_m)
    route = middle.shifted(_offset_left(name, size_m[1], middle, rng))
    if not size_m[0] / 2 < start_m < route.length_m - size_m[0] / 2 - 1:
        return None
    return Traveller(name, size_m, route, start_m, speed_mps)


def _offset_left(
    name: str, width_m: float, middle: Route, rng: np.random.Generator
) -> Float[np.ndarray, "n"]:
    """Cars keep to the middle of the lane; who is narrow keeps to the right of it."""
    room_m = np.maximum(middle.half_width_m - width_m / 2 - 0.1, 0)
    share = rng.uniform(0.5, 1.0) if width_m < 1.2 else rng.uniform(-0.2, 0.2)
    return -share * room_m


def _crowded(one: Traveller, other: Traveller) -> bool:
    grown = [
        (length_m + 2 * START_GAP_M, width_m + 0.3)
        for length_m, width_m, _ in (one.size_m, other.size_m)
    ]
    return bool(boxes_overlap(*one.start, grown[0], *other.start, grown[1]))


# ------------------------------------------------------------------------------------- the actors


def _actor(traveller: Traveller, seed: int, arc_m: Float[np.ndarray, "t"], town: Town) -> Actor:
    points_m, heading_rad = traveller.route.at(arc_m)
    rise_m = np.interp(arc_m, traveller.route.arc_m, traveller.route.rise_m)
    position_m = np.c_[points_m, town.terrain(points_m[:, 0], points_m[:, 1]) + rise_m]
    velocity_mps = np.gradient(position_m, STEP_S, axis=0)
    yaw_rad = (heading_rad + np.pi) % (2 * np.pi) - np.pi
    return Actor(0, traveller.type, seed, traveller.size_m, position_m, yaw_rad, velocity_mps)


def _distance_m(actor: Actor, uav_m: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t"]:
    """Distance in metres from the actor's box to the UAV at every step."""
    offset_m = uav_m - actor.position_m
    cos, sin = np.cos(actor.yaw_rad), np.sin(actor.yaw_rad)
    length_m, width_m, height_m = actor.size_m
    outside_m = np.stack(
        [
            np.abs(cos * offset_m[:, 0] + sin * offset_m[:, 1]) - length_m / 2,
            np.abs(-sin * offset_m[:, 0] + cos * offset_m[:, 1]) - width_m / 2,
            np.abs(offset_m[:, 2] - height_m / 2) - height_m / 2,
        ]
    )
    return np.linalg.norm(np.maximum(outside_m, 0), axis=0)


def _collide(one: Actor, other: Actor) -> bool:
    return bool(
        boxes_overlap(
            one.position_m[:, :2],
            one.yaw_rad,
            one.size_m[:2],
            other.position_m[:, :2],
            other.yaw_rad,
            other.size_m[:2],
        ).any()
    )


def boxes_overlap(
    centre_a_m: Float[np.ndarray, "*t 2"],
    yaw_a_rad: Float[np.ndarray, "*t"],
    size_a_m: tuple[float, float],
    centre_b_m: Float[np.ndarray, "*t 2"],
    yaw_b_rad: Float[np.ndarray, "*t"],
    size_b_m: tuple[float, float],
) -> Bool[np.ndarray, "*t"]:
    """Whether two rectangles (length, width) overlap: no side of either keeps them apart."""
    offset_m = centre_b_m - centre_a_m
    turned_rad = yaw_b_rad - yaw_a_rad
    cos, sin = np.abs(np.cos(turned_rad)), np.abs(np.sin(turned_rad))
    overlap = np.ones(np.shape(turned_rad), dtype=bool)
    for yaw_rad, mine_m, yours_m in (
        (yaw_a_rad, size_a_m, size_b_m),
        (yaw_b_rad, size_b_m, size_a_m),
    ):
        x, y = np.cos(yaw_rad), np.sin(yaw_rad)
        along_m = np.abs(x * offset_m[..., 0] + y * offset_m[..., 1])
        across_m = np.abs(-y * offset_m[..., 0] + x * offset_m[..., 1])
        overlap &= along_m <= (mine_m[0] + yours_m[0] * cos + yours_m[1] * sin) / 2
        overlap &= across_m <= (mine_m[1] + yours_m[0] * sin + yours_m[1] * cos) / 2
    return overlap
