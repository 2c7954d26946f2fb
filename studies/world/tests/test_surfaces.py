"""Areas in voxels against areas that are known."""

import numpy as np
import pytest

from src.geometry import VoxelGrid
from src.ontology import BUILDING, CAR, GROUND, VRU
from src.sim.mesh import mesh_of_solid
from studies.world.surfaces import surface_areas
from tests.sim.scenery import solid

GRID = VoxelGrid((0, -4, -2), (8, 4, 4), (16, 16, 12))


def triangles_of(*solids):
    meshes = [mesh_of_solid(each) for each in solids]
    classes = [np.full(len(m.faces), each.class_id, np.uint8) for m, each in zip(meshes, solids)]
    return np.concatenate([m.vertices_m[m.faces] for m in meshes]), np.concatenate(classes)


def area_m2(triangles):
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.linalg.norm(np.cross(u, v), axis=1).sum() / 2


def test_a_box_has_its_area_in_the_voxels_of_its_faces():
    box = solid(CAR, (2.0, 1.0, 1.0), (3.2, 0.3, 1.1))
    areas = surface_areas(*triangles_of(box), GRID)
    assert areas.sum() == pytest.approx(2 * (2 + 2 + 1), rel=1e-12)
    assert areas[..., CAR].sum() == areas.sum()
    # Its inside, and what is half a metre away, hold nothing.
    assert areas[6, 8, 6].sum() == 0
    assert areas[:3].sum() == areas[10:].sum() == 0
    top = areas[5, 8, 7, CAR]  # x 2.5..3, y 0..0.5, the top face at z = 1.6 is in 1.5..2
    assert top == pytest.approx(0.25, rel=1e-9)


def test_turned_shapes_keep_their_area_under_any_cutting():
    shapes = [
        solid(BUILDING, (2.0, 3.0, 1.5), (4.0, 0.4, 1.0), "box", 0.6),
        solid(VRU, (0.5, 0.5, 1.7), (2.0, -2.0, 0.6), "cylinder", 1.0),
        solid(GROUND, (2.5, 2.5, 2.0), (5.0, 2.0, 1.0), "ellipsoid", 0.3),
    ]
    triangles, class_id = triangles_of(*shapes)
    areas = surface_areas(triangles, class_id, GRID)
    for each in shapes:
        mine = area_m2(triangles[class_id == each.class_id])
        assert areas[..., each.class_id].sum() == pytest.approx(mine, rel=1e-9)


def test_a_tilted_plane_has_its_analytic_area_in_one_voxel():
    """z = x over one voxel: a rectangle of 0.5 by 0.5 sqrt 2."""
    corners = np.array([[0, -4, 0], [4, -4, 4], [4, 4, 4], [0, 4, 0]], dtype=float)
    triangles = corners[[[0, 1, 2], [0, 2, 3]]]
    areas = surface_areas(triangles, np.zeros(2, np.uint8), GRID)
    assert areas[2, 5, 6, 0] == pytest.approx(0.25 * 2**0.5, rel=1e-9)
    assert areas[2, 5, 7, 0] == areas[2, 5, 5, 0] == 0


def test_a_face_between_two_voxels_belongs_to_the_upper_one():
    corners = np.array([[1, 0, 0.5], [2, 0, 0.5], [2, 1, 0.5], [1, 1, 0.5]])
    areas = surface_areas(corners[[[0, 1, 2], [0, 2, 3]]], np.zeros(2, np.uint8), GRID)
    assert areas.sum() == pytest.approx(1.0)
    assert areas[:, :, 5].sum() == pytest.approx(1.0)  # z 0.5..1


def test_a_margin_reaches_into_the_neighbour():
    box = solid(CAR, (1.0, 1.0, 1.0), (3.0 - 0.0005, 0.25, 1.0))
    triangles = triangles_of(box)
    beyond = (7, 8, 6, CAR)  # begins at x = 3.5, half a millimetre from the box's face
    assert surface_areas(*triangles, GRID)[beyond] == 0
    assert surface_areas(*triangles, GRID, 1e-3)[beyond] > 0.1
    assert surface_areas(*triangles, GRID, 1e-4)[beyond] == 0


def test_what_is_outside_the_grid_does_not_count():
    wall = solid(BUILDING, (40.0, 0.2, 40.0), (0.0, 0.0, 0.0))
    areas = surface_areas(*triangles_of(wall), GRID)
    assert areas.sum() == pytest.approx(2 * 8 * 6, rel=1e-9)
