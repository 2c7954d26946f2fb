"""What a town is, as plain data: terrain, solids, ground patches, and the paths through it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .solid import Solid

HeightField = Callable[[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]], Float[np.ndarray, "*n"]]
"""Terrain height in metres at world x and y: smooth, gentle, and never exactly flat."""


@dataclass(frozen=True)
class GroundPatch:
    """A rectangle of ground that follows the terrain, ``rise_m`` above it (a kerb, a lawn).

    ``origin_m`` is its centre, ``yaw_rad`` the direction of its length. The classes say ``ground``.
    """

    origin_m: tuple[float, float]
    yaw_rad: float
    length_m: float
    width_m: float
    rise_m: float
    material: str


@dataclass(frozen=True)
class Path:
    """A directed way: a lane for vehicles, a pavement for people, or a corridor for the UAV.

    ``points_m`` are world x and y of a polyline in the direction of travel. ``half_width_m`` is the
    room to each side. ``successors`` index the paths of the same kind on which one may go on; an
    empty tuple is a dead end. ``rise_m`` is how far the surface lies above the terrain.
    """

    points_m: Float[np.ndarray, "n 2"]
    half_width_m: float
    speed_mps: float
    successors: tuple[int, ...]
    rise_m: float = 0.0

    @property
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
