"""What a camera sees, what something hides, and where it never looked."""

import numpy as np
import torch

from src.geometry import (
    VoxelGrid,
    camera_from_occ,
    front_mount,
    in_image,
    pinhole,
    project,
    rigid,
    rotation_from_euler,
)
from src.knowledge import HIDDEN, NEVER_LOOKED, SEEN, in_sight, knowledge, seen


def test_no_voxel_in_view_falls_between_rays():
    """A coarse image of a fine grid, with the camera tilted."""
    grid = VoxelGrid((0.0, -12.5, -10.0), (25.0, 12.5, 5.0), (50, 50, 30))
    tilt = rotation_from_euler(*torch.tensor([0.1, 0.1, 0.0], dtype=torch.float64))
    chain = camera_from_occ(
        rigid(tilt, torch.zeros(3, dtype=torch.float64)), front_mount((0.0, 0.0, 0.0))
    )
    camera = pinhole(96, 64, np.pi / 2)
    pix, depth_m = project(grid.centers(torch.float64), chain, camera)
    in_view = in_image(pix, depth_m, 96, 64).numpy()
    share = seen(np.zeros(grid.shape, bool), chain, camera, (96, 64), grid)[in_view].mean()
    assert share > 0.999


def test_what_an_occupied_voxel_hides_is_not_in_sight():
    occupied = np.zeros((10, 1, 1), dtype=bool)
    occupied[4] = True
    seen = in_sight(occupied, np.array([0.5, 0.5, 0.5]), np.array([[1.0, 0.0, 0.0]]))
    assert seen[:, 0, 0].tolist() == [True] * 5 + [False] * 5
    # The camera's own voxel would hide all.
    occupied[0] = True
    again = in_sight(occupied, np.array([0.5, 0.5, 0.5]), np.array([[1.0, 0.0, 0.0]]))
    assert (again == seen).all()


def test_a_wall_hides_what_is_behind_it_and_beside_the_camera_it_never_looked():
    grid = VoxelGrid((0.0, -10.0, -5.0), (20.0, 10.0, 5.0), (20, 20, 10))
    occupied = np.zeros(grid.shape, dtype=bool)
    occupied[8, 9:11, 4:6] = True
    mount = front_mount((0.0, 0.0, 0.0))
    chain = camera_from_occ(torch.eye(4, dtype=torch.float64), mount)
    camera = chain, pinhole(64, 64, np.pi / 2), (64, 64), grid
    told = knowledge(occupied, *camera)

    places = {(8, 9, 4): SEEN, (5, 9, 4): SEEN, (19, 0, 5): SEEN}
    places |= {(12, 9, 4): HIDDEN, (19, 10, 5): HIDDEN, (2, 19, 5): NEVER_LOOKED}
    assert {place: told[place] for place in places} == places
    assert ((told == SEEN) == seen(occupied, *camera)).all()
    assert (knowledge(np.zeros_like(occupied), *camera) != HIDDEN).all()
