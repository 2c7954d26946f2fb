"""Calibration against plain loops, and on predictors of known error."""

import math

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import Calibration
from src.ontology import CLASSES
from tests.metrics.inputs import LINE, assert_same, mean, random_logits, scores_of, updated

CUBE = VoxelGrid((0, -5, -5), (10, 5, 5), (20, 20, 20))


def ece_by_loops(voxels, bins):
    """Of (probability of the predicted class, whether it is right)."""
    gap = 0.0
    for n in range(bins):
        inside = [v for v in voxels if min(int(v[0] * bins), bins - 1) == n]
        if inside:
            gap += abs(sum(right for _, right in inside) - sum(p for p, _ in inside))
    return gap / len(voxels) if voxels else math.nan


def expected_scores(grid, logits, target, velocity, bins=15, horizon_s=5.0, min_speed_mps=5.0):
    center_m = grid.centers(torch.float64).tolist()
    voxels = []
    for b, x, y, z in torch.nonzero(target != 255).tolist():
        radius_m = horizon_s * max(math.hypot(*velocity[b].tolist()), min_speed_mps)
        if math.hypot(*center_m[x][y][z]) > radius_m:
            continue

        row = logits[b, :, x, y, z].tolist()
        whole = sum(math.exp(one) for one in row)
        true, predicted = int(target[b, x, y, z]), row.index(max(row))
        nll = math.log(whole) - row[true]
        voxels.append((math.exp(row[predicted]) / whole, true == predicted, true, predicted, nll))

    scores = {"ece": ece_by_loops([v[:2] for v in voxels], bins)}
    scores["nll"] = mean([v[4] for v in voxels])
    for n, name in enumerate(CLASSES):
        scores[f"ece/{name}"] = ece_by_loops([v[:2] for v in voxels if v[3] == n], bins)
        scores[f"nll/{name}"] = mean([v[4] for v in voxels if v[2] == n])
    return scores


@pytest.mark.parametrize(
    "arguments",
    [{}, {"bins": 1}, {"bins": 4}, {"horizon_s": 1.0}, {"horizon_s": 0.7, "min_speed_mps": 14.0}],
)
def test_every_score_matches_the_loops(grid, batch_for, arguments):
    batch = batch_for(Calibration)
    expected = expected_scores(grid, *batch, **arguments)
    actual = scores_of(Calibration(grid, **arguments), batch)
    assert actual == pytest.approx(expected, abs=1e-5, nan_ok=True)


# ------------------------------------------------------------- predictors of known error, limits


@pytest.mark.parametrize("factor", [1.0, 4.0, 0.25])
def test_a_calibrated_predictor_has_hardly_any_error_and_another_its_gap(factor):
    logits = random_logits(0, torch.zeros(2, *CUBE.shape), num_classes=4)
    p = logits.movedim(1, -1).flatten(0, -2).softmax(-1)
    drawn = torch.multinomial(p, 1, generator=torch.Generator().manual_seed(1))
    logits, target = factor * logits, drawn.view(2, *CUBE.shape)

    confidence, predicted = logits.softmax(1).max(1)
    gap = float((confidence.mean() - (predicted == target).float().mean()).abs())
    scores = scores_of(Calibration(CUBE, num_classes=4), (logits, target, torch.ones(2)))
    assert gap > 0.1 or factor == 1
    assert scores["ece"] == pytest.approx(gap, abs=0.02)


def line_logits(p):
    """Two classes; the second has probability ``p`` everywhere."""
    logits = torch.tensor([1 - p, p], dtype=torch.float64).log()
    return logits.view(1, 2, 1, 1, 1).expand(1, 2, *LINE.shape)


@pytest.mark.parametrize(("truth", "ece", "nll"), [(1, 0.0, 0.0), (0, 1.0, 64.0)])
def test_a_sure_predictor_has_no_error_if_right_and_one_cut_off_if_wrong(truth, ece, nll):
    target = torch.full((1, *LINE.shape), truth)
    batch = (line_logits(1.0), target, torch.ones(1))
    scores = scores_of(Calibration(LINE, num_classes=2), batch)
    assert (scores["ece"], scores["nll"]) == (ece, nll)


@pytest.mark.parametrize(("speed_mps", "inside"), [(0.0, 3), (5.0, 3), (7.0, 4), (1e9, 10)])
def test_only_voxels_in_the_bubble_count_and_its_edge_does(speed_mps, inside):
    calibration = Calibration(LINE, num_classes=2, horizon_s=1.0)
    target = torch.ones(1, *LINE.shape, dtype=torch.int64)
    calibration.update(line_logits(0.7), target, torch.tensor([speed_mps]))
    assert int(calibration.likelihood[:, 0].sum()) == inside


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.float16])
def test_logits_of_any_float_dtype(grid, batch_for, dtype):
    logits, target, velocity = batch_for(Calibration)
    logits = logits.to(dtype).requires_grad_()
    actual = updated(Calibration(grid), (logits, target, velocity))
    expected = updated(Calibration(grid), (logits.detach().double(), target, velocity))
    assert_same(actual.compute(), expected.compute())
