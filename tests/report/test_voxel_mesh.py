"""Voxels as meshes: the faces that can be seen, where they lie, and which way they look."""

import numpy as np
import pytest

from src.geometry import VoxelGrid
from src.ontology import BUILDING, CAR, CLASSES, COLORS, FREE, GROUND, UNKNOWN
from src.report.voxel_mesh import exposed_faces, voxel_meshes
from src.report.voxels import openness

GRID = VoxelGrid(lower_m=(0, -2, -1), upper_m=(5, 2, 2), shape=(10, 8, 6))


def count_faces(solid):
    """How many faces of solid voxels border on none, counted one by one."""
    padded = np.pad(solid, 1)
    steps = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    return sum(not padded[tuple(at + step)] for at in np.argwhere(padded) for step in steps)


@pytest.fixture(scope="module")
def labels():
    choices = [GROUND, BUILDING, CAR, FREE, UNKNOWN]
    return np.random.default_rng(0).choice(choices, GRID.shape).astype(np.uint8)


def test_faces_are_those_of_a_brute_force_search_and_counterclockwise_from_outside(labels):
    solid = labels == CAR
    neighbors, corners = exposed_faces(solid)
    first, second, third, fourth = np.moveaxis(corners, 1, 0)
    normals = np.cross(second - first, third - first)
    assert (np.cross(third - first, fourth - first) == normals).all()

    voxels = neighbors - normals
    assert len(voxels) == len(corners) == count_faces(solid) > 100
    assert solid[tuple(voxels.T)].all()
    assert not np.pad(solid, 1)[tuple(neighbors.T + 1)].any()
    assert len(np.unique(np.hstack([voxels, neighbors]), axis=0)) == len(voxels)
    # The middle of a face is half way between the middles of its two voxels.
    assert (corners.mean(axis=1) == (voxels + neighbors + 1) / 2).all()


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 2, 1)])
def test_a_block_has_no_face_inside(shape):
    x, y, z = shape
    assert len(exposed_faces(np.ones(shape, bool))[0]) == 2 * (x * y + y * z + z * x)


def test_openness_counts_the_free_voxels_around(labels):
    padded = np.pad(labels < FREE, 2)
    around = [padded[x : x + 3, y : y + 3, z : z + 3] for x, y, z in np.ndindex(12, 10, 8)]
    assert openness(labels < FREE).ravel().tolist() == [27 - block.sum() for block in around]


def test_a_mesh_has_its_class_and_lies_where_its_voxels_are_in_the_light_before_its_faces():
    labels = np.full(GRID.shape, FREE, dtype=np.uint8)
    labels[2:4, 3, 1] = CAR
    (mesh,) = voxel_meshes(labels, GRID)
    assert mesh.name == "car"
    assert mesh.colorscale[1][1] == "rgb{}".format(COLORS["car"])
    ends = [(min(mesh[axis]), max(mesh[axis])) for axis in "xyz"]
    assert np.allclose(ends, [(1.0, 2.0), (-0.5, 0.0), (-0.5, 0.0)])
    assert len(mesh.i) == len(mesh.intensity) == 20
    assert len(mesh.x) == 12, "corners are shared"
    # Before the two ends one voxel is solid, and before the sides two are.
    assert sorted(mesh.intensity) == [25] * 16 + [26] * 4
    points = np.stack([mesh[axis] for axis in "xyz"], axis=-1)
    first, second, third = (points[mesh[corner]] for corner in "ijk")
    outwards = first - points.mean(axis=0)
    assert ((np.cross(second - first, third - first) * outwards).sum(axis=-1) > 0).all()


def test_free_and_unknown_are_not_drawn_and_a_hidden_class_leaves_no_hole(labels):
    faces = {mesh.name: len(mesh.i) // 2 for mesh in voxel_meshes(labels, GRID)}
    drawn = (GROUND, BUILDING, CAR)
    assert faces == {CLASSES[kind]: count_faces(labels == kind) for kind in drawn}
