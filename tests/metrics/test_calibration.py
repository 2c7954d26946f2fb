"""Calibration against its definition, and on predictors of known error."""

import math

import pytest
import torch

from src.metrics import Calibration
from src.ontology import CLASSES
from tests.metrics.inputs import LINE, assert_same, scores_of, updated


def gap_of(p, right, bins):
    """ECE of probabilities of the predicted class, and whether it is right."""
    of_bin = (p * bins).long().clamp(max=bins - 1)
    gaps = [(right - p)[of_bin == n].sum().abs() for n in range(bins)]
    return float(sum(gaps) / len(p)) if len(p) else math.nan


def expected_scores(grid, logits, target, velocity, bins=15, horizon_s=5.0, min_speed_mps=5.0):
    reach_m = horizon_s * velocity.double().norm(dim=-1).clamp(min=min_speed_mps)
    near = grid.centers(torch.float64).norm(dim=-1) <= reach_m[:, None, None, None]
    known = near & (target != 255)
    p, true = logits.double().softmax(1).movedim(1, -1)[known], target[known].long()
    highest, predicted = p.max(dim=-1)
    nll, right = -p.gather(1, true[:, None])[:, 0].log(), predicted == true

    scores = {"ece": gap_of(highest, right.double(), bins), "nll": float(nll.mean())}
    for n, name in enumerate(CLASSES):
        said = predicted == n
        scores[f"ece/{name}"] = gap_of(highest[said], right[said].double(), bins)
        scores[f"nll/{name}"] = float(nll[true == n].mean())
    return scores


@pytest.mark.parametrize(
    "arguments",
    [{}, {"bins": 1}, {"bins": 4}, {"horizon_s": 1.0}, {"horizon_s": 0.7, "min_speed_mps": 14.0}],
)
def test_every_score_matches_its_definition(grid, batch_for, arguments):
    batch = batch_for(Calibration)
    expected = expected_scores(grid, *batch, **arguments)
    actual = scores_of(Calibration(grid, **arguments), batch)
    assert actual == pytest.approx(expected, abs=1e-5, nan_ok=True)


# ------------------------------------------------------------- predictors of known error, limits


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
