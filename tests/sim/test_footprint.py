"""Rectangles that turn: where they overlap, and how far things are from them."""

import numpy as np
import pytest

from src.sim.footprint import box_distance_m, boxes_overlap


def test_boxes_overlap_where_they_have_a_point_in_common():
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.linspace(-2, 2, 41), np.linspace(-1, 1, 21)), axis=-1)
    points_m = np.c_[grid.reshape(-1, 2), np.full(grid[..., 0].size, 0.5)]
    for _ in range(60):
        place_m, yaw_rad = np.r_[rng.uniform(-4, 4, 2), 0.0], np.float64(rng.uniform(-4, 4))
        tiled = np.tile(place_m, (len(points_m), 1)), np.full(len(points_m), yaw_rad)
        least_m = box_distance_m(points_m, *tiled, (3.0, 2.0, 1.0)).min()
        here = (np.zeros(2), np.float64(0), (4.0, 2.0))
        met = boxes_overlap(here, (place_m[:2], yaw_rad, (3.0, 2.0)))
        # Between the points of the grid there are 0.1 m.
        assert met if least_m == 0 else not met or least_m < 0.08


@pytest.mark.parametrize(
    ("point_m", "distance_m"),
    [
        ((0, 0, 1), 0.0),
        ((0, 5, 1), 3.0),
        ((4, 0, 1), 3.0),
        ((0, 0, 4.5), 3.0),
        ((0, 0, -2), 2.0),
        ((4, 6, 1), 5.0),
        ((4, 6, 13.5), 13.0),
    ],
)
def test_distance_from_a_box_that_stands_on_its_position(point_m, distance_m):
    """It is 4 m long, to the north, 2 m wide and 1.5 m high; it may stand anywhere."""
    for place_m in ((0.0, 0.0, 0.0), (7.0, -3.0, 20.0)):
        at_m = np.array([place_m])
        found_m = box_distance_m(at_m + point_m, at_m, np.array([np.pi / 2]), (4.0, 2.0, 1.5))
        assert found_m == pytest.approx([distance_m])
