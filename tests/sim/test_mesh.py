"""Meshes: closed, outward, of the right size, and the same shape as the solid says."""

import numpy as np
import pytest

from src.sim.mesh import ROUND_SIDES, mesh_of_solid
from src.sim.rays import RayScene
from tests.sim.scenery import solid

SHAPES = ("box", "cylinder", "cone", "ellipsoid")
SIZE_M, CENTER_M = (3.0, 2.0, 5.0), (4.0, -1.0, 2.0)
POLYGON = ROUND_SIDES / 2 * np.sin(2 * np.pi / ROUND_SIDES)
"""Area of the polygon whose corners lie on the unit circle."""


def placed(shape):
    return solid(0, SIZE_M, CENTER_M, shape, yaw_rad=0.6)


@pytest.fixture(params=SHAPES)
def shape(request):
    return request.param


def triangles(mesh):
    return mesh.vertices_m[mesh.faces]


def volume_m3(mesh):
    """By the divergence theorem; positive where the triangles run counter-clockwise outside."""
    a, b, c = triangles(mesh).transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum() / 6)


def ellipsoid_volume():
    """A pile of frustums, each between two similar polygons."""
    up = np.linspace(-np.pi / 2, np.pi / 2, ROUND_SIDES // 2 + 1)
    bottom, top, heights = np.cos(up[:-1]), np.cos(up[1:]), np.diff(np.sin(up))
    return POLYGON * ((bottom**2 + bottom * top + top**2) / 3 * heights).sum()


VOLUMES = {
    "box": 8.0,
    "cylinder": 2 * POLYGON,
    "cone": 2 * POLYGON / 3,
    "ellipsoid": ellipsoid_volume(),
}
"""Of the tessellated solid of size 2 x 2 x 2, worked out by hand."""


def test_the_volume_is_the_analytic_one_and_a_sphere_holds_it(shape):
    mesh = mesh_of_solid(placed(shape))
    assert volume_m3(mesh) == pytest.approx(VOLUMES[shape] * np.prod(SIZE_M) / 8)
    middle_m, reach_m = mesh.bounding_sphere()
    distance_m = np.linalg.norm(mesh.vertices_m - middle_m, axis=1)
    assert distance_m.max() == pytest.approx(reach_m)
    assert reach_m <= np.linalg.norm(SIZE_M) / 2 * 1.05


def test_rays_find_the_surface_where_the_solid_says(shape):
    body = placed(shape)
    rng = np.random.default_rng(0)
    origins_m = CENTER_M + rng.uniform(-2.5, 2.5, (4000, 3))
    directions = rng.standard_normal((4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = RayScene(triangles(mesh_of_solid(body)))
    distance_m, _ = rays.cast(origins_m, directions)

    hit = np.isfinite(distance_m)
    ends_m = origins_m[hit] + directions[hit] * distance_m[hit, None]
    assert hit.sum() > 500
    assert body.contains(ends_m, margin_m=1e-4).all()
    # A tessellated circle cuts at most (1 - cos(pi / 8)) of its radius off, a sphere twice that.
    assert not body.contains(ends_m, margin_m=-0.2 * min(SIZE_M)).any()
    middle = body.contains(origins_m, margin_m=-0.25 * min(SIZE_M))
    assert hit[middle].all()
