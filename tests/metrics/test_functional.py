"""The penalty curve, the distance shells and the tables."""

import math

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import functional as F

DISTANCE_M = torch.arange(1.0, 60.0, 2.0, dtype=torch.float64)


def penalties(speed_mps, **parameters):
    return 1 + F.Penalty(**parameters).excess(DISTANCE_M, speed_mps)


def test_the_penalty_follows_appendix_a4():
    curve = penalties(10.0)
    assert float(curve[0]) == pytest.approx(1 + 2 * math.exp(-0.05))
    assert float(curve[10]) == pytest.approx(1 + 2 * math.exp(-0.5 * 2.1))
    assert (curve.diff()[:24] < 0).all()


def test_the_bubble_ends_at_the_horizon_and_holds_its_edge():
    assert int((penalties(5.0) > 1).sum()) == 13  # 25 m, the paper's effective radius
    assert int((penalties(4.999) > 1).sum()) == 13
    assert int((penalties(5.001) > 1).sum()) == 13
    assert int((penalties(5.0, horizon_s=4.999) > 1).sum()) == 12
    assert int((penalties(1e9) > 1).sum()) == 30


def test_shells_give_back_the_distance_of_every_voxel():
    grid = VoxelGrid((0, -20, -16), (40, 20, 8), (25, 25, 15))
    shell_m, shell = F.distance_shells(grid)
    distance_m = grid.centers(torch.float64).norm(dim=-1).flatten()
    torch.testing.assert_close(shell_m[shell], distance_m, atol=1e-9, rtol=0)
    assert len(shell_m) < len(shell) / 10


def test_the_fixed_point_table_is_the_penalty_to_its_last_unit():
    shell_m = DISTANCE_M + 0.1
    for speed_mps in (5.5, 0.0, 20.0):
        table = F.Penalty().excess_table(shell_m, speed_mps)
        error = (table.double() / F.FIXED_POINT - F.Penalty().excess(shell_m, speed_mps)).abs()
        assert table.dtype == torch.int64
        assert 0 < float(error.max()) < 0.51 / F.FIXED_POINT


def tables_of(labels, target, excess, num_classes, backend):
    """Both tables of one frame, whose voxels are all at distances of their own."""
    codes = F.encode(labels, target, None, num_classes, ignore_index=255)
    shell = torch.arange(target.numel(), dtype=torch.int32)
    excess = [torch.tensor(excess)]
    tables = F.confusion_tables(codes, shell, excess, [None], 1, num_classes, backend)
    return [table[0, 0] for table in tables]


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_the_tables_are_indexed_by_target_then_prediction(backend):
    target = torch.tensor([2, 2, 7, 255], dtype=torch.uint8).view(1, 4, 1, 1)
    preds = torch.tensor([2, 8, 8, 3], dtype=torch.uint8).view(1, 4, 1, 1)
    codes = F.encode(preds, target, None, num_classes=9, ignore_index=255)
    assert codes.flatten().tolist() == [2 * 16 + 2, 2 * 16 + 8, 7 * 16 + 8, 255]

    count, penalty = tables_of(preds, target, [10, 20, 30, 40], 9, backend)
    expected_count, expected_penalty = torch.zeros(2, 9, 9, dtype=torch.int64)
    expected_count[2, 2] = expected_count[2, 8] = expected_count[7, 8] = 1
    expected_penalty[2, 8], expected_penalty[7, 8] = 20, 30
    assert torch.equal(count, expected_count)
    assert torch.equal(penalty, expected_penalty)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_fifteen_classes_fit_in_a_byte(backend):
    every = torch.arange(15, dtype=torch.uint8)
    labels = torch.cartesian_prod(every, every).T.contiguous()
    target, preds = labels.view(2, 1, 15, 15, 1)
    count, penalty = tables_of(preds, target, [3] * 225, 15, backend)
    assert torch.equal(count, torch.ones(15, 15, dtype=torch.int64))
    assert torch.equal(penalty, 3 * (1 - torch.eye(15, dtype=torch.int64)))


def test_a_backend_that_there_is_not_is_refused():
    with pytest.raises(UserError, match=r"^backend: 'cupy'"):
        F.is_compiled("cupy", torch.device("cpu"))
    with pytest.raises(UserError, match=r"^backend: numba.* cuda"):
        F.is_compiled("numba", torch.device("cuda"))


def test_mean_iou_leaves_out_nan_and_the_class_asked_for():
    iou = torch.tensor([0.2, torch.nan, 0.4, 0.9], dtype=torch.float64)
    assert float(F.mean_iou(iou)) == pytest.approx(0.5)
    assert float(F.mean_iou(iou, without=3)) == pytest.approx(0.3)
    assert F.mean_iou(iou[1:2]).isnan()
