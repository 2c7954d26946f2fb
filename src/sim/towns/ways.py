"""Ways between ports: a network's paths before they know which of them go on from which.

A *port* is a place at a junction where a street's lane, pavement or center line ends.
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..layout import Path


class Way(NamedTuple):
    """A path from one port to another, without its successors."""

    path: Path
    start: Hashable
    end: Hashable


def joined(ways: Sequence[Way]) -> tuple[Path, ...]:
    """Returns the paths with their successors, which start where they end.

    Nobody turns on the spot: the way back is no successor.
    """
    starts: dict[Hashable, list[int]] = {}
    for k, way in enumerate(ways):
        starts.setdefault(way.start, []).append(k)

    paths = []
    for path, start, end in ways:
        onward = tuple(k for k in starts.get(end, ()) if ways[k].end != start)
        paths.append(replace(path, successors=onward))
    return tuple(paths)
