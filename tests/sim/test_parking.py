"""Parked vehicles, measured on one ring of streets: out of everybody's way, and headed right."""

from collections.abc import Iterable

import numpy as np
import pytest

from src.sim.layout import GroundPatch, Path
from src.sim.solid import Solid
from src.sim.towns.network import LANE_HALF_WIDTH_M, WALK_HALF_WIDTH_M, Profile
from src.sim.towns.parking import BAY_RISE_M, DRIVE_RISE_M, LOT_RISE_M, drives, lot, park
from src.sim.towns.polyline import Spot
from src.sim.towns.streetscape import Streetscape
from tests.sim.roads import ring

WIDE = Profile(7.0, "road_2lane", 4.6, "paving", 9.0, 2.4, 7.0)


class Ring(Streetscape):
    """Three streets on flat ground; it remembers which solids each vehicle is made of."""

    def __init__(self, seed: int = 0, profile: Profile = WIDE):
        super().__init__("ring", ring(profile), np.random.default_rng(seed), relief_m=0.0)
        self.vehicles: list[list[Solid]] = []

    def place(self, *args) -> bool:
        before = len(self.solids)
        if placed := super().place(*args):
            self.vehicles.append(self.solids[before:])
        return placed

    def patches(self, rise_m: float) -> list[GroundPatch]:
        return [patch for patch in self.ground if patch.rise_m == rise_m]


def parked_along(share: float, seed: int = 0, profile: Profile = WIDE) -> Ring:
    site = Ring(seed, profile)
    for street in site.network.streets:
        park(site, street, share)
    return site


def corners_m(solids: Iterable[Solid]) -> np.ndarray:
    """Corners of the boxes around solids, each box turned like its solid."""
    unit = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    return np.concatenate(
        [unit * s.size_m @ s.scene_from_solid[:3, :3].T + s.scene_from_solid[:3, 3] for s in solids]
    )


def nearest(points: np.ndarray, paths: tuple[Path, ...]) -> tuple[np.ndarray, np.ndarray]:
    """From every point to the nearest of the paths' middle lines: distance, and which way that
    piece of it leads."""
    start = np.concatenate([path.points_m[:-1] for path in paths])
    along = np.concatenate([np.diff(path.points_m, axis=0) for path in paths])
    gap = points[:, None] - start
    t = np.clip((gap * along).sum(2) / (along**2).sum(1), 0, 1)
    distance_m = np.linalg.norm(gap - t[..., None] * along, axis=2)
    return distance_m.min(axis=1), along[distance_m.argmin(axis=1)]


@pytest.mark.parametrize("seed", range(3))
def test_a_parked_vehicle_stands_in_no_lane_and_on_no_walking_line(seed):
    site = parked_along(1.0, seed)
    assert len(site.vehicles) > 30
    covered_m = corners_m(site.solids)[:, :2]
    assert nearest(covered_m, site.town.lanes)[0].min() > LANE_HALF_WIDTH_M
    assert nearest(covered_m, site.town.walks)[0].min() > WALK_HALF_WIDTH_M


def test_it_is_headed_as_the_traffic_beside_it():
    site = parked_along(1.0)
    bays = site.patches(BAY_RISE_M)
    _, ahead = nearest(np.array([bay.origin_m for bay in bays]), site.town.lanes)
    heading_rad = np.arctan2(ahead[:, 1], ahead[:, 0])
    assert np.cos(heading_rad - [bay.yaw_rad for bay in bays]).min() > 0.99
    for vehicle, bay in zip(site.vehicles, bays, strict=True):
        # Its own parts are turned as its bay is.
        turned = vehicle[0].scene_from_solid[:2, 0]
        assert turned == pytest.approx([np.cos(bay.yaw_rad), np.sin(bay.yaw_rad)])


@pytest.mark.parametrize("place", ["kerb", "drive", "lot"])
def test_every_vehicle_stands_on_a_paved_patch_of_its_own(place):
    site = Ring(seed=3)
    if place == "lot":
        lot(site, Spot(80.0, 45.0, 0.4), columns=7, share=0.8, kind="car")
    for street in site.network.streets:
        if place == "kerb":
            park(site, street, 1.0)
        if place == "drive":
            drives(site, street, 14.0)

    rise_m = {"kerb": BAY_RISE_M, "drive": DRIVE_RISE_M, "lot": LOT_RISE_M}[place]
    patches = site.patches(rise_m)
    assert len(patches) == (1 if place == "lot" else len(site.vehicles))
    assert len(site.vehicles) > 7
    for vehicle in site.vehicles:
        corners = corners_m(vehicle)
        assert corners[:, 2].min() == pytest.approx(rise_m, abs=0.05)
        assert sum(all(covers(patch, corner) for corner in corners) for patch in patches) == 1


def covers(patch: GroundPatch, point: np.ndarray, slack_m: float = 0.1) -> bool:
    cos, sin = np.cos(patch.yaw_rad), np.sin(patch.yaw_rad)
    along, across = np.array([[cos, sin], [-sin, cos]]) @ (point[:2] - patch.origin_m)
    return abs(along) < patch.length_m / 2 + slack_m and abs(across) < patch.width_m / 2 + slack_m
