"""What becomes of the votes of a voxel that a VRU shares with the ground."""

import numpy as np

from src.ontology import FREE, GROUND, VRU
from src.sim.voxel_kernels import elect
from studies.world.lost_labels import first_with


def test_a_remedy_gives_a_shared_voxel_to_the_vru():
    votes = np.zeros((3, 1, 1, 8), np.int32)
    votes[0, 0, 0, [GROUND, VRU]] = 7, 3  # less than a third
    votes[1, 0, 0, [GROUND, VRU]] = 6, 4
    free = np.array([False, False, True]).reshape(3, 1, 1)
    assert elect(votes, free).ravel().tolist() == [GROUND, GROUND, FREE]
    assert first_with(1 / 3, votes, free).ravel().tolist() == [GROUND, VRU, FREE]
    assert first_with(0.0, votes, free).ravel().tolist() == [VRU, VRU, FREE]
