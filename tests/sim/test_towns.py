"""Towns, tested by probing: what must be free is free, what stands stands on the ground."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from src.errors import UserError
from src.ontology import BUILDING, CAR, GENERAL, LARGE_VEHICLE, OCCUPIED, THIN_STRUCTURE, VEGETATION
from src.sim.assets import ACTORS, bounds_m
from src.sim.layout import Path, Town
from src.sim.textures import PALETTE, TEXTURES
from src.sim.towns import build_town, town_names
from src.sim.towns.parking import BAY_RISE_M
from src.sim.towns.polyline import arc_m, parallel, point_at

TOWNS = town_names()
ALL = [(n, 0) for n in TOWNS] + [pytest.param((n, 1), marks=pytest.mark.slow) for n in TOWNS]


@cache
def town_of(name: str, seed: int) -> Town:
    return build_town(name, np.random.default_rng(seed))


@pytest.fixture(params=ALL, ids=str)
def town(request) -> Town:
    return town_of(*request.param)


def samples(town: Town, paths: tuple[Path, ...], half_widths, heights_m) -> np.ndarray:
    """Points over the paths: every 1.3 m along, at some parts of the half-width and heights."""
    points = []
    for path in paths:
        along_m = np.arange(0.1, arc_m(path.points_m)[-1], 1.3)
        for part in half_widths:
            xy = point_at(parallel(path.points_m, part * path.half_width_m), along_m)
            ground_m = town.terrain(xy[:, 0], xy[:, 1])
            points += [np.column_stack([xy, ground_m + height_m]) for height_m in heights_m]
    return np.concatenate(points)


def count_inside(town: Town, points: np.ndarray, classes=OCCUPIED) -> int:
    points = points[np.argsort(points[:, 0])]
    inside = np.zeros(len(points), dtype=bool)
    for solid in (solid for solid in town.solids if solid.class_id in classes):
        lower, upper = bounds_m(solid)
        span = slice(*np.searchsorted(points[:, 0], (lower[0], upper[0])))
        near = points[span]
        near = ((near >= lower) & (near <= upper)).all(axis=1)
        inside[span][near] |= solid.contains(points[span][near])
    return int(inside.sum())


def test_every_occupied_class_is_there_of_known_materials(town):
    classes = [solid.class_id for solid in town.solids]
    for class_id in (BUILDING, VEGETATION, THIN_STRUCTURE, GENERAL):
        assert classes.count(class_id) >= 5
    assert len(town.ground) > 10
    # At least four parked cars, of four wheels each.
    assert sum(s.class_id == CAR and s.shape == "cylinder" for s in town.solids) >= 4 * 4
    actors = {part.class_id for make in ACTORS.values() for part in make(np.random.default_rng(0))}
    # The ground is made of patches, not of solids.
    assert len(set(classes) | actors) == len(OCCUPIED) - 1
    assert 700 < len(town.solids) < 6000
    assert {solid.material for solid in town.solids} <= {*TEXTURES, *PALETTE}
    assert {patch.material for patch in town.ground} <= set(TEXTURES)


def test_thin_structures_stand_all_along_the_corridors(town):
    """What the flight must not overlook: on two of three pieces of a corridor there is some of it
    within 15 m."""
    thin = [s.scene_from_solid[:2, 3] for s in town.solids if s.class_id == THIN_STRUCTURE]
    way = samples(town, town.corridors, (0,), (0.0,))[::5, :2]
    gap_m = np.linalg.norm(way[:, None] - np.array(thin), axis=2)
    assert ((gap_m < 15).sum(axis=1) >= 5).mean() > 0.67


@pytest.mark.parametrize(
    "name", [n if n == "park" else pytest.param(n, marks=pytest.mark.slow) for n in TOWNS]
)
def test_the_seed_decides(name):
    def fingerprint(town: Town) -> tuple:
        places = [solid.scene_from_solid.tobytes() for solid in town.solids]
        ways = [path.successors for path in town.lanes + town.walks + town.corridors]
        return places, town.ground, ways

    again = build_town(name, np.random.default_rng(0))
    assert fingerprint(again) == fingerprint(town_of(name, 0))
    assert fingerprint(again) != fingerprint(town_of(name, 1))


@pytest.mark.parametrize("name", ["atlantis", "streetscape", "numpy.linalg", "a..b", "", 7, None])
def test_unknown_town_is_a_user_error_that_names_the_others(name):
    """Neither what the towns share nor a module without a function ``build`` is a town."""
    with pytest.raises(UserError, match=rf"^sim\.towns.*'{name}'.*downtown.*build\(rng\).*$"):
        build_town(name, np.random.default_rng(0))
    with pytest.raises(UserError, match=r"'subrub'.*'suburb'\?"):
        build_town("subrub", np.random.default_rng(0))


def test_a_town_of_one_s_own_is_one_module_of_any_package(tmp_path, monkeypatch):
    (tmp_path / "mytowns").mkdir()
    (tmp_path / "mytowns" / "square.py").write_text("def build(rng): return rng.random()")
    (tmp_path / "mytowns" / "broken.py").write_text("import no_such_library")
    monkeypatch.syspath_prepend(tmp_path)

    rng = np.random.default_rng(0)
    assert build_town("mytowns.square", rng) == np.random.default_rng(0).random()
    assert "mytowns.square" not in town_names()
    with pytest.raises(UserError, match=r"mytowns\.circle"):
        build_town("mytowns.circle", rng)
    # An error within a town's file is not taken for a town that is not there.
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        build_town("mytowns.broken", rng)


def test_only_thin_structures_cross_a_corridor_and_only_where_the_flight_climbs_over_them(town):
    high = samples(town, town.corridors, (-1, -0.5, 0, 0.5, 1), (9.2, 11.5, 14.0, 16.5, 17.9))
    assert len(high) > 5000
    assert count_inside(town, high) == 0
    low = samples(town, town.corridors, (-0.95, -0.5, 0, 0.5, 0.95), (1.6, 2.5, 3.6, 4.5))
    middle = samples(town, town.corridors, (-0.95, 0, 0.95), (5.5, 6.5, 7.5, 8.5))
    assert count_inside(town, low) == 0
    bridges = {BUILDING} if town.name == "waterfront" else set()
    assert count_inside(town, middle, set(OCCUPIED) - {THIN_STRUCTURE} - bridges) == 0
    assert not bridges or count_inside(town, middle, bridges) > 100


def test_vehicles_and_people_can_pass(town):
    lanes = samples(town, town.lanes, (-0.9, -0.5, 0, 0.5, 0.9), (0.5, 1.2, 2.0, 3.0))
    walks = samples(town, town.walks, (-0.6, 0, 0.6), (0.5, 1.0, 1.6))
    assert count_inside(town, lanes) == 0
    assert count_inside(town, walks) == 0


def test_paths_join_where_they_say(town):
    for paths in (town.lanes, town.walks, town.corridors):
        for path in paths:
            assert path.length_m > 0.5
            assert path.speed_mps > 0
            # Where the market begins, cars come to an end; nobody else gets stuck.
            assert path.successors or (town.name == "market" and paths is town.lanes)
            for k in path.successors:
                assert paths[k].points_m[0] == pytest.approx(path.points_m[-1], abs=1e-6)
                assert paths[k].points_m[-1] != pytest.approx(path.points_m[0], abs=1e-6)


def test_corridors_turn_gently_and_reach_far(town):
    assert all(path.half_width_m >= 2.0 and 3 <= path.speed_mps <= 9 for path in town.corridors)
    for start, path in enumerate(town.corridors):
        for k in path.successors:
            joint_rad = angle_rad(path.points_m[-2:], town.corridors[k].points_m[:2])
            assert joint_rad < np.deg2rad(50)

        # A way that takes the first successor that has not been flown yet.
        total_m, current, flown = 0.0, start, set()
        while current is not None and total_m < 120:
            flown.add(current)
            total_m += town.corridors[current].length_m
            successors = town.corridors[current].successors
            current = next((k for k in successors if k not in flown), None)
        assert total_m >= 120


def angle_rad(a: np.ndarray, b: np.ndarray) -> float:
    u, v = a[1] - a[0], b[1] - b[0]
    return float(np.arccos(np.clip(u @ v / np.linalg.norm(u) / np.linalg.norm(v), -1, 1)))


def test_lanes_keep_to_the_right(town):
    """To the left of a lane, within the width of a road, another one comes the other way."""
    lanes = [lane for lane in town.lanes if is_street(lane)]
    assert len(lanes) >= 12

    for lane in lanes:
        ahead = lane.points_m[1] - lane.points_m[0]
        left = np.array([-ahead[1], ahead[0]]) / np.linalg.norm(ahead)
        across = [
            (other.points_m[-1] - lane.points_m[0]) @ left
            for other in lanes
            if other is not lane
            and np.allclose(other.points_m[-1], lane.points_m[0], atol=7.5)
            and np.allclose(other.points_m[0], lane.points_m[-1], atol=7.5)
        ]
        assert len(across) == 1
        assert 2.5 < across[0] < 7.5


def is_street(lane: Path) -> bool:
    return lane.length_m > 40 and angle_rad(lane.points_m[:2], lane.points_m[-2:]) < np.deg2rad(75)


def test_nothing_floats_and_nothing_is_buried(town):
    """Each heap of touching solids has its lowest part in the ground, and not deep."""
    lower, upper = (np.stack(corner) for corner in zip(*map(bounds_m, town.solids)))
    for heap in heaps(lower, upper):
        bottom = heap[np.argmin(lower[heap, 2])]
        x, y = (lower[bottom, :2] + upper[bottom, :2]) / 2
        depth_m = float(town.terrain(x, y)) - lower[bottom, 2]
        class_id = town.solids[bottom].class_id

        # What is wide stands on the lowest ground under it, so its upper end reaches deeper.
        is_wide = max(town.solids[bottom].size_m[:2]) > 3
        deepest_m = 1.2 if class_id == BUILDING else 0.8 if is_wide else 0.5
        # What is afloat or stands in water is that much deeper.
        deepest_m += water_depth_m(town, x, y)
        # Who is parked stands in a bay, which lies above the terrain.
        highest_m = BAY_RISE_M + 0.01 if class_id in (CAR, LARGE_VEHICLE) else 0.0
        assert -highest_m <= depth_m < deepest_m, town.solids[bottom]


def water_depth_m(town: Town, x_m: float, y_m: float) -> float:
    """How far the water lies below the terrain at a place; 0 on land. Water is laid square."""
    for patch in town.ground:
        out_m = np.abs(np.subtract((x_m, y_m), patch.origin_m))
        if patch.material == "water" and (2 * out_m < (patch.length_m, patch.width_m)).all():
            return -patch.rise_m
    return 0.0


def heaps(lower: np.ndarray, upper: np.ndarray, slack_m: float = 0.03) -> Iterator[np.ndarray]:
    """Groups of boxes that touch."""
    left = np.ones(len(lower), dtype=bool)
    while left.any():
        heap = [int(np.argmax(left))]
        left[heap] = False
        for k in heap:  # It grows meanwhile by what touches box k.
            touch = (lower <= upper[k] + slack_m).all(1) & (upper >= lower[k] - slack_m).all(1)
            new = np.flatnonzero(touch & left)
            left[new] = False
            heap.extend(new.tolist())
        yield np.array(heap)


def test_the_ground_is_gentle_but_never_flat(town):
    x, y = np.meshgrid(np.arange(-80, 80, 5.0), np.arange(-80, 80, 5.0))
    height_m = town.terrain(x, y)
    assert height_m.shape == x.shape
    assert np.abs(height_m).max() < 0.6
    assert height_m.std() > 0.05
    slope = np.hypot(*np.gradient(height_m, 5.0))
    assert slope.max() < 0.08
