"""The ray march against a slab test of every voxel."""

import numpy as np
import pytest

from src.report.raycast import cast

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
    found = hits.on_voxel | hits.on_floor
    assert hits.on_voxel.sum() > 100
    assert 20 < hits.sunlit[found].sum() < found.sum() - 20

    for n, direction in enumerate(directions):
        box, distance = first_box(occupied, origin, direction)
        assert hits.on_voxel[n] == (box is not None)
        point, normal = origin + hits.distance[n] * direction, hits.normal[n]
        if box is not None:
            assert hits.distance[n] == pytest.approx(distance)
            assert hits.voxel[n].tolist() == box.tolist()
            # The middle of the face is half a voxel before that of its voxel.
            from_face = point - (box + 0.5 + 0.5 * normal)
            assert from_face @ normal == pytest.approx(0, abs=1e-9)
            assert direction @ normal < 0
            apart = 0.5 - np.abs(from_face)[normal == 0]
            assert hits.edge[n] == pytest.approx(apart.min(), abs=1e-9)
        if found[n]:
            shadow, _ = first_box(occupied, point + 1e-4 * normal, SUN)
            assert hits.sunlit[n] == (shadow is None and SUN @ normal > 0)


@pytest.mark.parametrize("start", [-5.0, 1.5])
def test_a_ray_along_an_axis_and_one_that_starts_inside_the_grid(start):
    occupied = np.zeros((5, 5, 5), dtype=bool)
    occupied[3, 1, 2] = True
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    hits = cast(occupied, np.array([start, 1.5, 2.5]), directions, SUN, 0.0)
    assert hits.on_voxel.tolist() == [True, False]
    assert hits.distance.tolist() == [3.0 - start, np.inf]


def test_the_floor_ends_with_the_footprint_and_lies_behind_voxels():
    occupied, origin = np.zeros((5, 5, 5), dtype=bool), np.array([-1.0, 1.5, 6.0])
    occupied[1, 1, 0] = True
    targets = [[3.5, 1.5, 0.0], [1.5, 1.5, 0.0], [5.5, 1.5, 0.0], [1.0, 5.5, 0.0]]
    hits = cast(occupied, origin, np.array(targets) - origin, SUN, 0.0)
    assert hits.on_floor.tolist() == [True, False, False, False]
    assert hits.on_voxel.tolist() == [False, True, False, False]
