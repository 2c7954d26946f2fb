"""The waterfront's own claims: water below the quay, and a road overhead that one can fly over."""

from functools import cache

import numpy as np

from src.ontology import BUILDING
from src.sim.assets import bounds_m
from src.sim.flight import FlightConfig, fly
from src.sim.layout import Path, Town
from src.sim.scene import Scene, pieces_of, static_parts
from src.sim.solid import Solid
from src.sim.towns import build_town
from src.sim.towns.polyline import arc_m, point_at

DECK_M = 5.9, 6.8
"""Underside and top of the elevated road, above z = 0."""


@cache
def town() -> Town:
    return build_town("waterfront", np.random.default_rng(0))


def standing(class_id: int) -> list[Solid]:
    return [solid for solid in town().solids if solid.class_id == class_id]


def deck() -> list[Solid]:
    """The slabs of the level part of the overpass."""
    built = standing(BUILDING)
    heights_m = np.array([bounds_m(solid) for solid in built])[:, :, 2]
    return [built[k] for k in np.flatnonzero(np.abs(heights_m - DECK_M).max(axis=1) < 1e-6)]


def under_the_deck(paths: tuple[Path, ...]) -> np.ndarray:
    """Places on the middle lines of paths that lie under the deck, with the ground's height."""
    points = [
        point_at(path.points_m, np.arange(0.1, arc_m(path.points_m)[-1], 0.5)) for path in paths
    ]
    xy = np.concatenate(points)
    xyz = np.column_stack([xy, np.full(len(xy), sum(DECK_M) / 2)])
    xy = xy[np.any([solid.contains(xyz) for solid in deck()], axis=0)]
    return np.column_stack([xy, town().terrain(xy[:, 0], xy[:, 1])])


def test_the_water_lies_below_the_quay_and_no_street_leads_into_it():
    sea = [patch for patch in town().ground if patch.material == "water"]
    assert sum(patch.length_m * patch.width_m for patch in sea) > 10_000
    assert all(-1.5 <= patch.rise_m <= -1.0 for patch in sea)
    shore_y_m = max(patch.origin_m[1] + patch.width_m / 2 for patch in sea)
    for path in town().lanes + town().walks + town().corridors:
        assert path.points_m[:, 1].min() - path.half_width_m > shore_y_m
    dry = [patch for patch in town().ground if patch.material != "water"]
    assert all(patch.origin_m[1] > shore_y_m for patch in dry)


def test_the_overpass_crosses_streets_at_a_clear_height():
    lanes, corridors = under_the_deck(town().lanes), under_the_deck(town().corridors)
    assert len(deck()) > 20
    assert min(len(lanes), len(corridors)) > 100
    clear_m = DECK_M[0] - np.concatenate([lanes, corridors])[:, 2]
    assert clear_m.min() >= 5.0
    assert clear_m.max() <= 6.6


def test_the_flight_climbs_over_the_overpass():
    lower, upper = zip(*map(bounds_m, deck()))
    lower, upper = np.min(lower, axis=0), np.max(upper, axis=0)
    cast = Scene(static_parts(pieces_of(town())), ()).cast_static
    above_m = []
    for seed in range(6):
        flight = fly(town(), np.random.default_rng(seed), cast, FlightConfig(tries=8))
        within = (flight.position_m > lower) & (flight.position_m < upper)
        above_m += list(flight.position_m[within[:, :2].all(axis=1), 2])
    assert len(above_m) > 50, "no flight crosses it"
    assert min(above_m) > DECK_M[1] + 1.0
