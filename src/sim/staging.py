"""The stage of one clip, from its seed alone: the town, the flight through it, and its traffic."""

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .flight import Flight, FlightConfig, fly
from .layout import Town
from .pilot import STEP_HZ
from .scene import Piece, Scene, pieces_of, static_parts
from .towns import build_town
from .traffic import TrafficConfig, simulate_traffic

# The part of the town that lies within this distance of the flight is drawn.
DRAWN_RADIUS_M = 90.0


@dataclass(frozen=True)
class ClipPlan:
    """The place of one clip in the dataset, and its conditions."""

    clip_id: str
    town: str
    weather: str
    index: int


@dataclass(frozen=True)
class Place:
    """A town, its meshes, and the whole of it for rays."""

    town: Town
    pieces: tuple[Piece, ...]
    whole: Scene


def generator_for(seed: int, *names: str | int) -> np.random.Generator:
    """Returns a random generator that depends on the seed and on its purpose, and on nothing else.

    So no clip depends on the clips made before it, nor on the worker that makes it.
    """
    keys = [name if isinstance(name, int) else zlib.crc32(name.encode()) for name in names]
    return np.random.default_rng(np.random.SeedSequence([seed, *keys]))


# The next clip is often flown in the same town, and building one takes seconds.
@lru_cache(maxsize=2)
def place_of(name: str, seed: int, drawing: int = 0) -> Place:
    """Builds a town and its meshes; each ``drawing`` of it has other streets and houses."""
    others = (drawing,) if drawing else ()
    town = build_town(name, generator_for(seed, "town", name, *others))
    pieces = pieces_of(town)
    return Place(town, pieces, Scene(static_parts(pieces), ()))


def stage_clip(
    plan: ClipPlan,
    seed: int,
    flight_config: FlightConfig,
    traffic_config: TrafficConfig,
    town_seeds: int = 1,
) -> tuple[Flight, Scene]:
    """Returns the flight of a clip and the scene around it: the town near the route, and actors.

    The ``town_seeds`` drawings of a town take turns, clip by clip.
    """
    place = place_of(plan.town, seed, plan.index % town_seeds)
    rng = generator_for(seed, "flight", plan.town, plan.index)
    flight = fly(place.town, rng, place.whole.cast_static, flight_config)

    rng = generator_for(seed, "traffic", plan.town, plan.index)
    actors = simulate_traffic(place.town, rng, traffic_config, flight.position_m)

    every_second_m = flight.position_m[::STEP_HZ, :2]
    parts = static_parts(place.pieces, every_second_m, DRAWN_RADIUS_M)
    return flight, Scene(parts, actors)
