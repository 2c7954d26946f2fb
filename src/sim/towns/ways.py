"""Ways between ports: a network's paths before they know which of them go on from which.

A *port* is a place at a junction where a street's lane, pavement or center line ends.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

from ..layout import Gate, Path
from .polyline import Polyline


@dataclass(frozen=True)
class Way:
    """A path from one port to another."""

    points_m: Polyline
    start: Hashable
    end: Hashable
    half_width_m: float
    speed_mps: float
    rise_m: float
    gate: Gate | None = None

    def both_ways(self) -> list["Way"]:
        """Returns this way, and the way back along it."""
        return [self, replace(self, points_m=self.points_m[::-1], start=self.end, end=self.start)]


def joined(ways: Sequence[Way]) -> tuple[Path, ...]:
    """Paths whose successors start where they end; nobody turns on the spot."""
    starts: dict[Hashable, list[int]] = {}
    for k, way in enumerate(ways):
        starts.setdefault(way.start, []).append(k)

    paths = []
    for way in ways:
        onward = tuple(k for k in starts.get(way.end, ()) if ways[k].end != way.start)
        room = (way.half_width_m, way.speed_mps)
        paths.append(Path(way.points_m, *room, onward, way.rise_m, way.gate))
    return tuple(paths)
