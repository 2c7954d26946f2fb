"""The ray march against a slab test of every voxel."""

import numpy as np
import pytest

from src.report.raycast import FLOOR, MISS, VOXEL, cast

SUN = np.array([-0.4, 0.5, 0.9])


def first_box(occupied, origin, direction):
    """Nearest occupied voxel along a ray and its entry distance, by a slab test of all of them."""
    boxes = np.argwhere(occupied)
    with np.errstate(divide="ignore"):
        to_faces = (np.stack([boxes, boxes + 1]) - origin) / direction
    enter, leave = to_faces.min(axis=0).max(axis=1), to_faces.max(axis=0).min(axis=1)
    hit = (enter < leave) & (enter > 0)
    if not hit.any():
        return None, np.inf
    nearest = np.flatnonzero(hit)[enter[hit].argmin()]
    return boxes[nearest], enter[nearest]


@pytest.fixture(scope="module")
def random_cast():
    """Scattered voxels, an origin outside the grid, directions into it, and their hits."""
    rng = np.random.default_rng(3)
    occupied = rng.random((7, 6, 5)) < 0.15
    origin = np.array([-9.0, 2.0, 8.0])
    directions = rng.uniform((0, 0, 0), (7, 6, 5), (400, 3)) - origin
    hits = cast(occupied, origin, directions, SUN, floor=0.0)
    return occupied, origin, directions, hits


def test_hits_are_those_of_a_slab_test_of_every_voxel(random_cast):
    occupied, origin, directions, hits = random_cast
    assert (hits.kind == VOXEL).sum() > 100

    for n, direction in enumerate(directions):
        box, distance = first_box(occupied, origin, direction)
        assert (hits.kind[n] == VOXEL) == (box is not None)
        if box is None:
            continue
        assert hits.distance[n] == pytest.approx(distance)
        assert hits.voxel[n].tolist() == box.tolist()
        point = origin + distance * direction
        face = hits.voxel[n, hits.axis[n]] + (hits.side[n] > 0)
        assert point[hits.axis[n]] == pytest.approx(face)
        assert hits.side[n] == -np.sign(direction[hits.axis[n]])


def test_shadows_are_those_of_a_slab_test_towards_the_sun(random_cast):
    occupied, origin, directions, hits = random_cast
    found = np.flatnonzero(hits.kind != MISS)
    assert 20 < hits.sunlit[found].sum() < len(found) - 20
    for n in found:
        normal = np.eye(3)[hits.axis[n]] * hits.side[n]
        point = origin + hits.distance[n] * directions[n] + 1e-4 * normal
        blocked = first_box(occupied, point, SUN)[0] is not None or SUN @ normal <= 0
        assert hits.sunlit[n] == (not blocked)


def test_a_ray_along_an_axis_and_one_that_starts_inside_the_grid():
    occupied = np.zeros((4, 4, 4), dtype=bool)
    occupied[3, 1, 2] = True
    for start in (-5.0, 1.5):
        origin = np.array([start, 1.5, 2.5])
        hits = cast(occupied, origin, np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), SUN, 0.0)
        assert hits.kind.tolist() == [VOXEL, MISS]
        assert hits.distance[0] == 3.0 - start


def test_the_floor_ends_with_the_footprint_and_lies_behind_voxels():
    occupied = np.zeros((4, 4, 4), dtype=bool)
    occupied[1, 1, 0] = True
    origin = np.array([-1.0, 1.5, 6.0])
    targets = np.array([[3.5, 1.5, 0.0], [1.5, 1.5, 0.0], [4.5, 1.5, 0.0], [1.0, 4.5, 0.0]])
    hits = cast(occupied, origin, targets - origin, SUN, floor=0.0)
    assert hits.kind.tolist() == [FLOOR, VOXEL, MISS, MISS]


def test_corners_are_closed_and_lone_faces_open():
    occupied = np.zeros((5, 5, 5), dtype=bool)
    occupied[:, :, 0] = True
    occupied[3, :, 1] = True
    origin = np.array([2.5, 2.5, 9.0])
    targets = np.array([[2.95, 2.5, 1.0], [0.5, 2.5, 1.0], [3.5, 2.5, 2.0]])
    in_corner, in_open, on_top = cast(occupied, origin, targets - origin, SUN, 0.0).openness
    assert in_corner < 0.6
    assert in_open == 1.0
    assert on_top == 1.0
