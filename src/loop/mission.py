"""Where the UAV shall fly: straight routes beside the corridors, which nothing keeps free."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..errors import UserError
from ..limits import require_at_least
from ..sim.rays import spread_directions
from ..sim.solid import Rng
from ..sim.staging import Place, generator_for, place_of
from ..sim.towns import builder_of
from ..sim.towns.polyline import beside
from .vectors import Vector

# A way begins and ends with so much room around it, which so many rays look for.
ROOM_M, ROOM_RAYS = 1.5, 128


@dataclass(frozen=True)
class Mission:
    """A straight way through a town, ``height_m`` above the terrain.

    A map is a town of its own seed. ``index`` is the number of the route among those drawn on it,
    which also decides traffic, gusts and noise.
    """

    town: str
    seed: int
    index: int
    weather: str
    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    height_m: float

    @property
    def map(self) -> str:
        return f"{self.town}-{self.seed}"

    @property
    def flight(self) -> str:
        return f"{self.map}/{self.index:03d}"

    @property
    def place(self) -> Place:
        return place_of(self.town, self.seed)

    def rng(self, purpose: str, frame: int = 0) -> Rng:
        """Returns the generator for one purpose, and of what differs by frame for one frame."""
        return generator_for(self.seed, purpose, self.town, self.index, frame)

    def at(self, along_m: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        """Returns the places so far along the way, in the world."""
        along_m = np.asarray(along_m, dtype=np.float64)
        x_m = self.x_m + np.cos(self.yaw_rad) * along_m
        y_m = self.y_m + np.sin(self.yaw_rad) * along_m
        return np.stack([x_m, y_m, self.place.town.terrain(x_m, y_m) + self.height_m], axis=-1)

    def along(self, place_m: Vector) -> float:
        """Returns the distance of a place along the way, between 0 and its length."""
        ahead = np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad)])
        along_m = float(ahead @ (place_m[:2] - (self.x_m, self.y_m)))
        return min(max(along_m, 0.0), self.length_m)


@dataclass(frozen=True)
class VergeMissions:
    """Draws routes ``offset_m`` beyond the edge of a corridor, parallel to it.

    There are ``maps`` maps: the towns take turns, and each has a seed of its own, from
    ``first_seed`` on. Of every map there shall be ``conflict`` routes, on which a UAV that sees
    nothing hits something, and ``clear`` ones; a map gives up after ``tries`` routes. Raises
    `UserError` for no towns, no flights, or settings out of range.
    """

    towns: Sequence[str]
    weathers: Sequence[str]
    maps: int
    conflict: int
    clear: int
    first_seed: int
    length_m: float
    offset_m: tuple[float, float]
    height_m: tuple[float, float]
    tries: int

    def __post_init__(self) -> None:
        for name in ("towns", "weathers"):
            if not getattr(self, name):
                raise UserError(f"mission.{name}: empty; give one or more")
        for name in self.towns:
            builder_of(name)

        for name in ("offset_m", "height_m"):
            low, high = getattr(self, name)
            if not 0 <= low <= high < math.inf:
                raise UserError(
                    f"mission.{name}: [{low}, {high}]; give two numbers of 0 or more, in order"
                )

        require_at_least(0, "mission", vars(self), "conflict", "clear", "first_seed")
        require_at_least(1, "mission", vars(self), "maps", "length_m", "tries")
        if self.conflict + self.clear == 0:
            raise UserError("mission.conflict: 0, and mission.clear: 0; that leaves no flight")

    def places(self) -> list[tuple[str, int]]:
        """Returns the town and the seed of every map."""
        return [
            (self.towns[number % len(self.towns)], self.first_seed + number)
            for number in range(self.maps)
        ]

    def drawn(self, town: str, seed: int) -> Iterator[Mission]:
        """Yields routes of a map that begin and end in the open, as they are drawn."""
        place = place_of(town, seed)
        for index in range(self.tries):
            mission = self._draw(place, town, seed, index)
            if in_the_open(mission, place):
                yield mission

    def _draw(self, place: Place, town: str, seed: int, index: int) -> Mission:
        rng = generator_for(seed, "mission", town, index)
        lengths_m = np.array([path.length_m for path in place.town.corridors])
        corridor = place.town.corridors[rng.choice(len(lengths_m), p=lengths_m / lengths_m.sum())]

        side = rng.choice((-1.0, 1.0))
        left_m = side * (corridor.half_width_m + rng.uniform(*self.offset_m))
        spot = beside(corridor.points_m, rng.uniform(0, corridor.length_m), left_m)
        height_m = float(rng.uniform(*self.height_m))
        weather = self.weathers[int(rng.integers(len(self.weathers)))]
        return Mission(town, seed, index, weather, *spot, self.length_m, height_m)


def in_the_open(mission: Mission, place: Place) -> bool:
    """Tests both ends of a mission for the sky above them and room around them."""
    ends_m = mission.at(np.array([0.0, mission.length_m]))
    upwards = np.broadcast_to([0.0, 0.0, 1.0], ends_m.shape)
    if np.isfinite(place.whole.cast_static(ends_m, upwards)).any():
        return False
    around = spread_directions(ROOM_RAYS, (1.0, -1.0))
    origins_m = np.repeat(ends_m, ROOM_RAYS, axis=0)
    return bool(place.whole.cast_static(origins_m, np.tile(around, (2, 1))).min() > ROOM_M)
