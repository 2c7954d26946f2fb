"""The stage of one clip, from its seed alone: the town, the flight through it, and its traffic."""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..ontology import ACTOR_TYPES
from .assets import ACTORS
from .flight import Flight, FlightConfig, fly
from .layout import Town
from .pilot import STEP_HZ
from .scene import Piece, Scene, SceneActor, parts_of, pieces_of, static_parts
from .towns import build_town
from .traffic import ActorTrack, TrafficConfig, simulate_traffic

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
def place_of(name: str, seed: int) -> Place:
    """Builds a town and its meshes."""
    town = build_town(name, generator_for(seed, "town", name))
    pieces = pieces_of(town)
    return Place(town, pieces, Scene(static_parts(pieces), ()))


def stage_clip(
    plan: ClipPlan, seed: int, flight_config: FlightConfig, traffic_config: TrafficConfig
) -> tuple[Flight, Scene]:
    """Returns the flight of a clip and the scene around it: the town near the route, and actors."""
    place = place_of(plan.town, seed)
    rng = generator_for(seed, "flight", plan.town, plan.index)
    flight = fly(place.town, rng, place.whole.cast_static, flight_config)

    rng = generator_for(seed, "traffic", plan.town, plan.index)
    tracks = simulate_traffic(place.town, rng, traffic_config, flight.position_m)

    every_second_m = flight.position_m[::STEP_HZ, :2]
    parts = static_parts(place.pieces, every_second_m, DRAWN_RADIUS_M)
    return flight, Scene(parts, scene_actors(tracks))


def scene_actors(tracks: Iterable[ActorTrack]) -> tuple[SceneActor, ...]:
    """Gives moving actors their shapes, drawn from each actor's own seed."""
    return tuple(
        SceneActor(
            actor_id=track.actor_id,
            type=track.type,
            class_id=ACTOR_TYPES[track.type],
            size_m=track.size_m,
            parts=parts_of(ACTORS[track.type](np.random.default_rng(track.seed))),
            world_from_actor=track.world_from_actor,
            velocity_mps=track.velocity_mps,
        )
        for track in tracks
    )
