"""The distance shells, the penalty in sums, and counts by [target, prediction]."""

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import functional as F


def test_shells_give_back_the_distance_of_every_voxel():
    grid = VoxelGrid((0, -20, -16), (40, 20, 8), (25, 25, 15))
    shell_m, shell = F.distance_shells(grid)
    distance_m = grid.centers(torch.float64).norm(dim=-1).flatten()
    torch.testing.assert_close(shell_m[shell], distance_m, atol=1e-9, rtol=0)
    assert len(shell_m) < len(shell) / 10


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_counts_are_indexed_by_target_then_prediction_of_up_to_fifteen_classes(backend):
    every = torch.arange(15, dtype=torch.uint8)
    labels = torch.cartesian_prod(every, every).T.contiguous()
    target, preds = labels.view(2, 1, 15, 15, 1)
    target[0, 2, 7] = 255

    codes = F.encode(preds, target, None, num_classes=15, ignore_index=255)
    shell = torch.arange(225, dtype=torch.int32)
    excess = torch.arange(225)
    count, penalty = F.confusion_counts(codes, shell, [excess], [None], 1, 15, backend)
    expected = torch.ones(15, 15, dtype=torch.int64)
    expected[2, 7] = 0
    assert torch.equal(count[0, 0], expected)
    expected *= (1 - torch.eye(15, dtype=torch.int64)) * excess.view(15, 15)
    assert torch.equal(penalty[0, 0], expected)


def test_a_backend_that_there_is_not_is_refused():
    with pytest.raises(UserError, match=r"^backend: 'cupy'"):
        F.is_compiled("cupy", torch.device("cpu"))
    with pytest.raises(UserError, match=r"^backend: numba.* cuda"):
        F.is_compiled("numba", torch.device("cuda"))
