"""What the 3-D picture and the map show, and where."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import BUILDING, CAR, FREE, THIN_STRUCTURE, UNKNOWN, VEGETATION, VRU
from src.report.overlay import FRUSTUM_COLOR
from src.report.top import render_top
from src.report.view import Frustum
from src.report.voxels import PALETTE, ground_level, render_voxels, view_of
from tests.report.street import (
    FLOOR,
    GRID,
    HEIGHT,
    WIDTH,
    fill,
    labels_of,
    pixels_of,
    street,
    tilted_frustum,
)

SIZE = (200, 150)
both = pytest.mark.parametrize("render", [render_voxels, render_top])


def middle_of(image, class_id):
    found = pixels_of(image, PALETTE[class_id])
    assert len(found) > 3
    return found.mean(axis=0)


@both
def test_the_uavs_left_is_left_and_what_is_ahead_is_further_up(render):
    boxes = (CAR, (12, 6, -10), (16, 10, -8)), (VRU, (40, -10, -10), (44, -6, -8))
    image = render(labels_of(FLOOR, *boxes), GRID, SIZE)
    car, vru = middle_of(image, CAR), middle_of(image, VRU)
    assert car[1] < SIZE[0] / 2 < vru[1]
    assert vru[0] < car[0]


def test_what_is_higher_is_further_up_and_what_stands_in_front_hides_what_is_behind():
    car, vru = (CAR, (30, 5, -10), (34, 9, -6)), (VRU, (30, -9, 0), (34, -5, 4))
    wall = (BUILDING, (20, 0, -10), (22, 15, 2))
    view = view_of([labels_of(FLOOR, car, vru)], GRID, SIZE)
    seen = render_voxels(labels_of(FLOOR, car, vru), GRID, SIZE, view)
    hidden = render_voxels(labels_of(FLOOR, car, vru, wall), GRID, SIZE, view)
    assert middle_of(seen, VRU)[0] < middle_of(seen, CAR)[0]
    assert len(pixels_of(hidden, PALETTE[CAR])) == 0


def test_the_foot_of_a_wall_is_darker_than_the_open():
    floor, wall = (CAR, *FLOOR[1:]), (BUILDING, (46, -25, -10), (50, 25, 5))
    view = view_of([labels_of(floor, wall)], GRID, SIZE)
    lone, walled = (
        render_voxels(labels_of(*boxes), GRID, SIZE, view).sum(axis=-1, dtype=int)
        for boxes in ([floor], [floor, wall])
    )
    colored = pixels_of(render_voxels(labels_of(floor, wall), GRID, SIZE, view), PALETTE[CAR])
    foot = tuple(colored[colored[:, 0] <= colored[:, 0].min() + 1].T)
    assert (walled[foot] <= lone[foot]).all()
    assert (walled[foot] < lone[foot]).sum() > 50


def test_free_and_unknown_are_not_drawn_and_an_empty_grid_shows_footprint_and_uav_only():
    empty, free = (np.full(GRID.shape, kind, dtype=np.uint8) for kind in (UNKNOWN, FREE))
    image = render_voxels(empty, GRID, SIZE)
    assert (image == render_voxels(free, GRID, SIZE)).all()
    assert image.min() < 100, "the UAV"
    assert np.ptp(image, axis=-1).max() < 20, "no class color"
    assert ground_level(empty, GRID) == GRID.lower_m[2]


@both
def test_pictures_are_deterministic_and_as_large_as_asked_and_other_grids_refused(render):
    first, second = (render(street(), GRID, (161, 123)) for _ in range(2))
    assert (first.shape, first.dtype) == ((123, 161, 3), np.uint8)
    assert (first == second).all()
    with pytest.raises(UserError, match=r"grid\.shape \[100, 100, 60\]"):
        render(street(), VoxelGrid(), SIZE)


def test_every_occupied_voxel_the_uav_and_the_ground_are_in_the_view():
    labels = street()
    points = GRID.centers(torch.float64)[torch.from_numpy(labels < FREE)]
    uav = torch.tensor([[0, 0, 0], [0, 0, ground_level(labels, GRID)]], dtype=torch.float64)
    camera = Frustum.observer(view_of([labels], GRID, SIZE), SIZE)
    pix, depth_m = camera.project(torch.cat([points, uav]))
    assert (depth_m > 0).all()
    room = torch.minimum(pix, torch.tensor(SIZE) - pix).amin(dim=0)
    assert (room >= 0).all()
    assert room.min() < 0.05 * max(SIZE), "and no further away than that needs"


def test_the_corners_of_a_frustum_are_those_of_its_image():
    frustum = tilted_frustum(0.3, -0.2)
    pix, depth_m = frustum.project(frustum.corners(10.0))
    corners = torch.tensor([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]]).double()
    torch.testing.assert_close(pix, corners, atol=1e-4, rtol=0)
    torch.testing.assert_close(depth_m, torch.full((4,), 10.0).double())
    edges = {tuple(sorted(map(tuple, edge))) for edge in pairwise(frustum.outline(10.0))}
    assert len(edges) == 8


def test_the_frustum_is_drawn_and_voxels_hide_it():
    def orange(labels):
        image = render_voxels(labels, GRID, (400, 300), view, tilted_frustum(0.0, 0.0)).astype(int)
        return (np.abs(image - FRUSTUM_COLOR).sum(axis=-1) < 60).sum()

    view = view_of([street()], GRID, (400, 300))
    open_air = orange(labels_of())
    assert open_air > 50
    assert orange(labels_of((BUILDING, (-1, -25, -20), (1, 25, 10)))) < open_air / 4


def test_a_given_floor_makes_two_pictures_comparable():
    view = (-60.0, 0.0, 45.0)
    shallow = labels_of((CAR, (20, 8, 0), (25, 12, 2)))
    same = render_voxels(shallow, GRID, SIZE, view, floor_m=-10.0)
    assert (same != render_voxels(shallow, GRID, SIZE, view)).any()
    empty = render_voxels(labels_of(), GRID, SIZE, view, floor_m=-10.0)
    differing = (same != empty).any(axis=-1).mean()
    assert 0 < differing < 0.05, "the car and its shadow alone"


def test_the_map_shows_the_highest_class_brighter_when_higher():
    low, high = ((VEGETATION, (20, -5, z), (30, 5, z + 1)) for z in (-9, 8))
    wire = (THIN_STRUCTURE, (20, -5, 9), (30, 5, 10))
    lower, higher, wired = (
        render_top(labels_of(FLOOR, *boxes), GRID, (480, 480)).astype(int)
        for boxes in ([low], [high], [low, wire])
    )
    row, column = middle_of(lower, VEGETATION).round().astype(int)
    assert higher[row, column].sum() > lower[row, column].sum()
    assert len(pixels_of(wired, PALETTE[VEGETATION])) == 0
    assert len(pixels_of(wired, PALETTE[THIN_STRUCTURE])) > 1000


def test_the_map_is_to_scale_and_tells_free_from_unknown():
    labels = np.full(GRID.shape, UNKNOWN, dtype=np.uint8)
    fill(labels, GRID, FREE, (0, -25, 0), (25, 25, 5))
    image = render_top(labels, GRID, (480, 480))
    free = np.argwhere((image == (236, 242, 248)).all(axis=-1))
    rows, columns = np.ptp(free, axis=0) + 1
    assert columns / rows == pytest.approx(2.0, abs=0.03)
    assert np.median(free[:, 0]) > 240, "the near half is at the bottom"
    below = image[free[:, 0].max() + 8 :, : 240 - 20].max(axis=-1) < 60
    bar_pix = np.flatnonzero(below[below.sum(axis=1).argmax()])
    run_pix = np.flatnonzero(np.diff(bar_pix, append=9999) > 1)[0] + 1
    assert run_pix == pytest.approx(columns / 5, abs=2), "10 m of 50 m"
