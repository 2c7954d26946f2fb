"""What a camera sees, what something hides, and where it never looked."""

import numpy as np
import torch

from src.geometry import VoxelGrid, camera_from_occ, front_mount, pinhole
from src.knowledge import HIDDEN, NEVER_LOOKED, SEEN, in_sight, knowledge, seen


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
