"""Solids: what is inside."""

import numpy as np
import pytest

from tests.sim.scenery import solid

FILLED = {"box": 1.0, "cylinder": np.pi / 4, "cone": np.pi / 12, "ellipsoid": np.pi / 6}
"""Volume as a share of the box around it."""


@pytest.mark.parametrize(("shape", "share"), FILLED.items())
def test_the_share_of_random_points_inside_is_the_volume(shape, share):
    size_m, center_m = np.array([3.0, 2.0, 5.0]), np.array([4.0, -1.0, 2.0])
    body = solid(0, size_m, center_m, shape, yaw_rad=0.6)
    around_m = center_m + np.random.default_rng(0).uniform(-4, 4, (200_000, 3))
    assert body.contains(around_m).mean() * 8**3 == pytest.approx(share * size_m.prod(), rel=0.05)


@pytest.mark.parametrize("shape", FILLED)
def test_a_margin_grows_and_shrinks_along_every_axis(shape):
    body = solid(0, (3.0, 2.0, 5.0), (0, 0, 0), shape)
    for axis in range(2):
        # The base of a cone, the middle of anything else.
        edge = np.array([[0.0, 0.0, -2.49 if shape == "cone" else 0.0]])
        edge[0, axis] = body.size_m[axis] / 2 - 0.05
        assert body.contains(edge).all()
        assert not body.contains(edge, margin_m=-0.2).any()
        edge[0, axis] += 0.1
        assert not body.contains(edge).any()
        assert body.contains(edge, margin_m=0.2).all()
    assert not body.contains(np.zeros((1, 3)), margin_m=-1.0).any()
