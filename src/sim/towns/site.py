"""A building site: it takes assets where there is room for them and refuses them elsewhere.

The room that must stay free is sampled from the paths: corridors up to the ceiling of the flight,
lanes to the height of a bus, pavements to the height of a head.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ...ontology import THIN_STRUCTURE
from ..assets.parts import Vector, bounds_m, placed, upright
from ..layout import GroundPatch, HeightField, Path, Town
from ..solid import Solid
from .network import Network
from .polyline import arc_m, parallel, point_at

Footprints = Float[np.ndarray, "n 4 2"]
Boxes = Float[np.ndarray, "n 2 3"]

# Heights above the ground at which the room over paths is sampled.
_FLIGHT_M = np.arange(2.0, 19.0, 1.25)
# Wires, mast arms, bare branches and bridges may cross a corridor: the flight climbs over them.
_FLIGHT_BUT_OVERHEAD_M = _FLIGHT_M[(_FLIGHT_M < 5) | (_FLIGHT_M > 8.6)]
_LANE_M = np.arange(0.5, 3.6, 0.75)
_WALK_M = np.array([0.5, 1.1, 1.7])


class Keepout:
    """Samples of the room above paths; ``margin_m`` bridges the gaps between them."""

    def __init__(self, paths: Iterable[Path], heights_m: Float[np.ndarray, "h"], step_m: float):
        self.heights_m, self.margin_m = heights_m, 0.75 * step_m
        columns = [np.zeros((0, 2))]
        for path in paths:
            count = int(np.ceil(2 * path.half_width_m / step_m)) + 1
            along_m = np.arange(0, arc_m(path.points_m)[-1], step_m)
            for left_m in np.linspace(-path.half_width_m, path.half_width_m, count):
                columns.append(point_at(parallel(path.points_m, left_m), along_m))

        # Sorted by x, so that a search finds what is near a solid.
        self.columns_m = np.unique(np.round(np.concatenate(columns), 3), axis=0)

    def blocked_by(self, solid: Solid, ground_m: float) -> bool:
        """Returns whether a solid in the world reaches into the room."""
        lower, upper = (b + s * self.margin_m for b, s in zip(bounds_m(solid), (-1, 1)))
        z = self.heights_m + ground_m
        z = z[(z >= lower[2]) & (z <= upper[2])]
        xy = self.columns_m[slice(*np.searchsorted(self.columns_m[:, 0], (lower[0], upper[0])))]
        xy = xy[(xy[:, 1] >= lower[1]) & (xy[:, 1] <= upper[1])]

        points = np.concatenate([np.repeat(xy, len(z), 0), np.tile(z, len(xy))[:, None]], axis=1)
        return bool(solid.contains(points, self.margin_m).any())


class Site:
    """Grows a town: ground, solids, and the room that they must leave."""

    def __init__(self, name: str, network: Network, terrain: HeightField):
        self.network, self.terrain = network, terrain
        corridors = network.corridors()
        self.town = Town(name, terrain, (), (), network.lanes(), network.walks(), corridors)
        self.solids: list[Solid] = []
        self.ground: list[GroundPatch] = []

        self._flight = Keepout(corridors, _FLIGHT_M, 0.8)
        self._flight_but_overhead = Keepout(corridors, _FLIGHT_BUT_OVERHEAD_M, 0.8)
        self._lanes = Keepout(self.town.lanes, _LANE_M, 0.4)
        self._walks = Keepout(self.town.walks, _WALK_M, 0.4)
        self._footprints: Footprints = np.zeros((0, 4, 2))
        self._boxes_m: Boxes = np.zeros((0, 2, 3))

    def finished(self) -> Town:
        """Returns the town with all that was placed."""
        return replace(self.town, solids=tuple(self.solids), ground=tuple(self.ground))

    def height_m(self, x_m: float, y_m: float) -> float:
        """Returns the height of the terrain."""
        return float(self.terrain(np.array(x_m), np.array(y_m)))

    def lay(
        self, x_m: float, y_m: float, yaw_rad: float, size_m: Vector, rise_m: float, material: str
    ) -> None:
        """Adds a rectangle of ground by its middle and its size along and across ``yaw_rad``."""
        # A patch is plain data, whatever numbers it was computed from.
        x_m, y_m, yaw_rad, *size_m = map(float, (x_m, y_m, yaw_rad, *size_m))
        self.ground.append(GroundPatch((x_m, y_m), yaw_rad, *size_m, rise_m, material))

    def place(
        self, asset: Sequence[Solid], x_m: float, y_m: float, yaw_rad: float, rise_m: float = 0.0
    ) -> bool:
        """Stands an asset on the lowest ground under it; returns whether there was room."""
        flat = placed(asset, upright(x_m, y_m, 0.0, yaw_rad))
        footprints = np.stack([_footprint(solid) for solid in flat])
        corners = footprints.reshape(-1, 2)
        ground_m = float(self.terrain(corners[:, 0], corners[:, 1]).min())
        solids = placed(flat, upright(0.0, 0.0, ground_m + rise_m))
        boxes_m = np.array([bounds_m(solid) for solid in solids])

        if self._taken(footprints, boxes_m) or any(self._in_the_way(s, ground_m) for s in solids):
            return False
        self.solids += solids
        self._occupy(footprints, boxes_m)
        return True

    def hang(self, solids: Sequence[Solid], ground_m: float, overhead: bool = False) -> bool:
        """Adds what hangs between things that stand, given in the world, if nothing flies there.

        What is ``overhead`` is a bridge: it may cross corridors in the band that is free for wires,
        because the flight climbs over it, and nothing that is placed later may run through it.
        """
        if any(self._in_the_way(solid, ground_m, overhead) for solid in solids):
            return False
        self.solids += solids
        if overhead:
            footprints = np.stack([_footprint(solid) for solid in solids])
            self._occupy(footprints, np.array([bounds_m(solid) for solid in solids]))
        return True

    def _in_the_way(self, solid: Solid, ground_m: float, overhead: bool = False) -> bool:
        overhead |= solid.class_id == THIN_STRUCTURE
        flight = self._flight_but_overhead if overhead else self._flight
        keepouts = (flight, self._lanes, self._walks)
        return any(keepout.blocked_by(solid, ground_m) for keepout in keepouts)

    def _occupy(self, footprints: Footprints, boxes_m: Boxes) -> None:
        self._footprints = np.concatenate([self._footprints, footprints])
        self._boxes_m = np.concatenate([self._boxes_m, boxes_m])

    def _taken(self, footprints: Footprints, boxes_m: Boxes) -> bool:
        """Returns whether any of the solids that stand already would be run through."""
        lower, upper = boxes_m[:, 0].min(axis=0), boxes_m[:, 1].max(axis=0)
        near = _meet(self._boxes_m, np.stack([lower, upper]))
        footprints_near, boxes_near_m = self._footprints[near], self._boxes_m[near]
        return any(
            _overlap(footprint, other)
            for footprint, box_m in zip(footprints, boxes_m)
            for other in footprints_near[_meet(boxes_near_m, box_m)]
        )


def _meet(boxes_m: Boxes, box_m: Float[np.ndarray, "2 3"]) -> Bool[np.ndarray, "n"]:
    return ((boxes_m[:, 0] < box_m[1]) & (boxes_m[:, 1] > box_m[0])).all(axis=1)


def _footprint(solid: Solid) -> Float[np.ndarray, "4 2"]:
    """Corners of the rectangle that a solid covers: its own where upright, else axis-aligned."""
    unit = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    if solid.scene_from_solid[2, 2] > 0.999:
        corners = unit * np.asarray(solid.size_m[:2]) / 2
        return corners @ solid.scene_from_solid[:2, :2].T + solid.scene_from_solid[:2, 3]
    lower, upper = bounds_m(solid)
    return (lower[:2] + upper[:2]) / 2 + unit * (upper[:2] - lower[:2]) / 2


def _overlap(a: Float[np.ndarray, "4 2"], b: Float[np.ndarray, "4 2"]) -> bool:
    """Returns whether two rectangles overlap: no side of either separates them."""
    for sides in (np.diff(a[:3], axis=0), np.diff(b[:3], axis=0)):
        shadow_a, shadow_b = a @ sides.T, b @ sides.T
        gap = np.maximum(shadow_a.min(0) - shadow_b.max(0), shadow_b.min(0) - shadow_a.max(0))
        if (gap >= 0).any():
            return False
    return True
