"""Calibration against plain loops, and on predictors of known error."""

import math

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import Calibration
from src.ontology import CLASSES
from tests.metrics.inputs import LINE, assert_same, random_logits, scores_of, updated

CUBE = VoxelGrid((0, -5, -5), (10, 5, 5), (20, 20, 20))


@pytest.fixture
def batch(batch_for):
    """Logits, target, velocity."""
    return batch_for(Calibration)


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

    def mean(values):
        return sum(values) / len(values) if values else math.nan

    scores = {"ece": ece_by_loops([v[:2] for v in voxels], bins)}
    scores["nll"] = mean([v[4] for v in voxels])
    for n, name in enumerate(CLASSES):
        scores[f"ece/{name}"] = ece_by_loops([v[:2] for v in voxels if v[3] == n], bins)
        scores[f"nll/{name}"] = mean([v[4] for v in voxels if v[2] == n])
    return scores


# ------------------------------------------------------------------------- against the loops


@pytest.mark.parametrize(
    "arguments",
    [{}, {"bins": 1}, {"bins": 4}, {"horizon_s": 1.0}, {"horizon_s": 0.7, "min_speed_mps": 14.0}],
)
def test_every_score_matches_the_loops(grid, batch, arguments):
    expected = expected_scores(grid, *batch, **arguments)
    actual = scores_of(Calibration(grid, **arguments), batch)
    assert actual == pytest.approx(expected, abs=1e-5, nan_ok=True)


# ----------------------------------------------------------------- predictors of known error


@pytest.fixture
def calibrated():
    """Logits of four classes, and a target drawn from their probabilities."""
    logits = random_logits(0, torch.zeros(2, *CUBE.shape), num_classes=4)
    p = logits.movedim(1, -1).flatten(0, -2).softmax(-1)
    drawn = torch.multinomial(p, 1, generator=torch.Generator().manual_seed(1))
    return logits, drawn.view(2, *CUBE.shape)


def test_a_calibrated_predictor_has_hardly_any_error(calibrated):
    scores = scores_of(Calibration(CUBE, num_classes=4), (*calibrated, torch.ones(2)))
    assert scores["ece"] < 0.02
    assert all(scores[f"ece/{n}"] < 0.04 for n in range(4))


@pytest.mark.parametrize(("factor", "sign"), [(4.0, 1), (0.25, -1)])
def test_sharper_and_flatter_logits_than_the_truth_have_their_gap_as_error(
    calibrated, factor, sign
):
    logits, target = factor * calibrated[0], calibrated[1]
    confidence, predicted = logits.softmax(1).max(1)
    gap = float(confidence.mean() - (predicted == target).float().mean())
    scores = scores_of(Calibration(CUBE, num_classes=4), (logits, target, torch.ones(2)))
    assert sign * gap > 0.1
    assert scores["ece"] == pytest.approx(sign * gap, abs=0.01)


def line_logits(p):
    """Two classes; the second has probability ``p`` everywhere."""
    logits = torch.tensor([1 - p, p], dtype=torch.float64).log()
    return logits.view(1, 2, 1, 1, 1).expand(1, 2, *LINE.shape)


@pytest.mark.parametrize("right", [0, 6, 9, 10])
def test_saying_nine_tenths_costs_how_often_that_is_wrong(right):
    target = torch.zeros(1, *LINE.shape, dtype=torch.int64)
    target[0, :right] = 1
    batch = (line_logits(0.9), target, torch.ones(1))
    scores = scores_of(Calibration(LINE, num_classes=2), batch)
    assert scores["ece"] == pytest.approx(abs(0.9 - right / 10), abs=1e-6)
    assert scores["ece/1"] == scores["ece"]
    assert math.isnan(scores["ece/0"])
    nll = [-math.log(0.1) if right < 10 else math.nan, -math.log(0.9) if right else math.nan]
    assert [scores["nll/0"], scores["nll/1"]] == pytest.approx(nll, abs=1e-6, nan_ok=True)


def test_gaps_of_two_classes_that_cancel_in_a_bin_show_in_their_own_errors():
    target = torch.zeros(1, *LINE.shape, dtype=torch.int64)
    logits = torch.zeros(1, 2, *LINE.shape)
    logits[0, 0, :5], logits[0, 1, 5:] = 1e-4, 1e-4
    scores = scores_of(Calibration(LINE, num_classes=2), (logits, target, torch.ones(1)))
    assert scores["ece"] == pytest.approx(0.0, abs=1e-3)
    assert (scores["ece/0"], scores["ece/1"]) == pytest.approx((0.5, 0.5), abs=1e-3)


# -------------------------------------------------------------------- bins, bubble and limits


@pytest.mark.parametrize(("p", "bin_"), [(1.0, 3), (0.76, 3), (0.74, 2), (0.51, 2), (0.5, 2)])
def test_a_probability_falls_into_its_bin_one_into_the_last_and_an_edge_above_it(p, bin_):
    target = torch.ones(1, *LINE.shape, dtype=torch.int64)
    calibration = Calibration(LINE, num_classes=2, bins=4)
    calibration.update(line_logits(p), target, torch.ones(1))
    voxels = calibration.reliability[:, :, 0].sum(0)
    assert torch.nonzero(voxels).flatten().tolist() == [bin_]


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
    assert int(calibration.reliability[..., 0].sum()) == inside


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.float16])
def test_logits_of_any_float_dtype(grid, batch, dtype):
    logits, target, velocity = batch
    logits = logits.to(dtype).requires_grad_()
    actual = updated(Calibration(grid), (logits, target, velocity))
    expected = updated(Calibration(grid), (logits.detach().double(), target, velocity))
    assert_same(actual.compute(), expected.compute())
