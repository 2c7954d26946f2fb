"""A town as plain data: terrain, solids, ground patches, and the paths through it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from .solid import Solid

# Terrain height in metres at world x and y: smooth, gentle, and never exactly flat.
HeightField = Callable[[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]], Float[np.ndarray, "*n"]]


@dataclass(frozen=True)
class GroundPatch:
    """A rectangle of ground that follows the terrain, ``rise_m`` above it (a kerb, a lawn).

    ``origin_m`` is its center, ``yaw_rad`` the direction of its length. The classes say ``ground``.
    """

    origin_m: tuple[float, float]
    yaw_rad: float
    length_m: float
    width_m: float
    rise_m: float
    material: str


@dataclass(frozen=True)
class Gate:
    """A place on a path where one may have to wait before going over a junction.

    It is ``at_m`` from the path's start: a stop line, or where a pedestrian crossing leaves the
    kerb. A lane's gate leads over the path that follows, the turn; the gate of a crossing
    (``is_crossing``) over the rest of its own path. The junction is left ``clear_m`` beyond the end
    of that path (before its end where negative).

    ``phase``, out of ``phases``, is the one in which traffic from this arm of the junction has
    green, and people may not cross the arm; it is None where there are no lights.
    """

    junction: int
    at_m: float
    clear_m: float
    is_crossing: bool
    phase: int | None
    phases: int


@dataclass(frozen=True)
class Path:
    """A directed way: a lane for vehicles, a pavement for people, or a corridor for the UAV.

    ``points_m`` are world x and y of a polyline in the direction of travel. ``half_width_m`` is the
    room to each side. ``successors`` index the paths of the same kind on which one may go on; an
    empty tuple is a dead end. ``rise_m`` is how far the surface lies above the terrain. ``gate`` is
    where one may have to wait for others, if anywhere.
    """

    points_m: Float[np.ndarray, "n 2"]
    half_width_m: float
    speed_mps: float
    successors: tuple[int, ...]
    rise_m: float = 0.0
    gate: Gate | None = None

    @cached_property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


@dataclass(frozen=True)
class Town:
    """A static place. Lanes carry vehicles, walks carry people, corridors carry the UAV.

    A corridor is free of everything that reaches higher than what the flight can climb over; what
    crosses it overhead (wires, branches) is found by the flight's own ray casts.
    """

    name: str
    terrain: HeightField
    solids: tuple[Solid, ...]
    ground: tuple[GroundPatch, ...]
    lanes: tuple[Path, ...]
    walks: tuple[Path, ...]
    corridors: tuple[Path, ...]
