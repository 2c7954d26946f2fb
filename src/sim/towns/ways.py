"""Ways between ports: what a network's paths are before they know which of them go on from where.

A *port* is a place at a junction where a street's lane, pavement or centre line ends.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

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


def both_ways(
    points_m: Polyline,
    start: Hashable,
    end: Hashable,
    half_width_m: float,
    speed_mps: float,
    rise_m: float,
    gate: Gate | None = None,
) -> list[Way]:
    """A way there and the same way back."""
    room = (half_width_m, speed_mps, rise_m, gate)
    return [Way(points_m, start, end, *room), Way(points_m[::-1], end, start, *room)]


def joined(ways: Sequence[Way]) -> tuple[Path, ...]:
    """Paths whose successors start where they end; nobody turns on the spot."""
    starts: dict[Hashable, list[int]] = {}
    for k, way in enumerate(ways):
        starts.setdefault(way.start, []).append(k)
    return tuple(
        Path(
            way.points_m,
            way.half_width_m,
            way.speed_mps,
            tuple(k for k in starts.get(way.end, ()) if ways[k].end != way.start),
            way.rise_m,
            way.gate,
        )
        for way in ways
    )
