"""The shapes of things, from a passed-in generator: plain solids in their own frame."""

from collections.abc import Callable

from ..solid import Rng, Solid
from .parts import bounds_m, extent_m, placed, upright
from .people import bicycle, motorcycle, pedestrian
from .vehicles import bus, car, truck

__all__ = ["ACTORS", "bounds_m", "extent_m", "placed", "upright"]

# What moves, by the types of `ontology.ACTOR_TYPES`, in the actor frame.
ACTORS: dict[str, Callable[[Rng], tuple[Solid, ...]]] = {
    "car": car,
    "truck": truck,
    "bus": bus,
    "pedestrian": pedestrian,
    "bicycle": bicycle,
    "motorcycle": motorcycle,
}
