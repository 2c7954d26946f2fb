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


def test_hits_and_shadows_are_those_of_a_slab_test_of_every_voxel():
    rng = np.random.default_rng(3)
    occupied = rng.random((7, 6, 5)) < 0.15
    origin = np.array([-9.0, 2.0, 8.0])
    directions = rng.uniform((0, 0, 0), (7, 6, 5), (400, 3)) - origin
    hits = cast(occupied, origin, directions, SUN, 0.0)
    assert (hits.kind == VOXEL).sum() > 100
    found = hits.kind != MISS
    assert 20 < hits.sunlit[found].sum() < found.sum() - 20

    for n, direction in enumerate(directions):
        box, distance = first_box(occupied, origin, direction)
        assert (hits.kind[n] == VOXEL) == (box is not None)
        point = origin + hits.distance[n] * direction
        if box is not None:
            assert hits.distance[n] == pytest.approx(distance)
            assert hits.voxel[n].tolist() == box.tolist()
            face = hits.voxel[n, hits.axis[n]] + (hits.side[n] > 0)
            assert point[hits.axis[n]] == pytest.approx(face)
            assert hits.side[n] == -np.sign(direction[hits.axis[n]])
        if found[n]:
            normal = np.eye(3)[hits.axis[n]] * hits.side[n]
            shadow, _ = first_box(occupied, point + 1e-4 * normal, SUN)
            assert hits.sunlit[n] == (shadow is None and SUN @ normal > 0)


def hits_of(voxels, origin, targets):
    """What rays from one place to others hit in a grid of 5 x 5 x 5 with some voxels."""
    occupied = np.zeros((5, 5, 5), dtype=bool)
    for voxel in voxels:
        occupied[voxel] = True
    return cast(occupied, np.array(origin), np.array(targets) - origin, SUN, 0.0)


@pytest.mark.parametrize("start", [-5.0, 1.5])
def test_a_ray_along_an_axis_and_one_that_starts_inside_the_grid(start):
    targets = [[start + 1, 1.5, 2.5], [start, 2.5, 2.5]]
    hits = hits_of([(3, 1, 2)], [start, 1.5, 2.5], targets)
    assert hits.kind.tolist() == [VOXEL, MISS]
    assert hits.distance[0] == 3.0 - start


def test_the_floor_ends_with_the_footprint_and_lies_behind_voxels():
    targets = [[3.5, 1.5, 0.0], [1.5, 1.5, 0.0], [5.5, 1.5, 0.0], [1.0, 5.5, 0.0]]
    hits = hits_of([(1, 1, 0)], [-1.0, 1.5, 6.0], targets)
    assert hits.kind.tolist() == [FLOOR, VOXEL, MISS, MISS]


def test_corners_are_closed_and_lone_faces_open():
    ground, wall = np.s_[:, :, 0], np.s_[3, :, 1]
    targets = [[2.95, 2.5, 1.0], [0.5, 2.5, 1.0], [3.5, 2.5, 2.0]]
    in_corner, in_open, on_top = hits_of([ground, wall], [2.5, 2.5, 9.0], targets).openness
    assert in_corner < 0.6
    assert in_open == on_top == 1.0
