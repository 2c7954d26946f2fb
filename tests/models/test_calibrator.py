"""Calibrated logits: the frequencies that they were fitted to, at every distance."""

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.models.calibrator import KNOTS_M, Calibrator, fitted, shares_of
from src.ontology import NUM_CLASSES

GRID = VoxelGrid((0.0, -2.0, -2.0), (32.0, 2.0, 2.0), (16, 2, 2))


def too_sure(temperature, voxels=20_000):
    """Labels drawn from logits, and those logits after somebody has overstated them."""
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(voxels, NUM_CLASSES, generator=generator) * 2
    target = torch.multinomial(logits.softmax(dim=1), 1, generator=generator)[:, 0]
    distance_m = torch.rand(voxels, generator=generator) * 40
    return logits * temperature(distance_m)[:, None], target, distance_m


def test_one_temperature_is_found_again():
    facts = fitted("temperature", *too_sure(lambda distance_m: torch.full_like(distance_m, 2.5)))
    assert facts["scale"][0] == pytest.approx([0.4] * NUM_CLASSES, abs=0.01)
    assert facts["shift"] == [[0.0] * NUM_CLASSES]


def test_a_shift_of_one_class_is_found_again():
    logits, target, distance_m = too_sure(torch.ones_like)
    logits[:, 3] += 2.0
    facts = fitted("vector", logits, target, distance_m)
    shift = torch.tensor(facts["shift"][0])
    others = shift[torch.arange(NUM_CLASSES) != 3].mean()
    assert float(shift[3] - others) == pytest.approx(-2.0, abs=0.1)


def test_what_changes_with_the_distance_is_found_at_each_distance_alone():
    sample = too_sure(lambda distance_m: torch.where(distance_m < 10, 1.0, 3.0))
    scale = torch.tensor(fitted("distance", *sample)["scale"])
    assert scale.shape == (len(KNOTS_M), NUM_CLASSES)
    assert scale[0].mean() == pytest.approx(1.0, abs=0.1)
    assert scale[-1].mean() == pytest.approx(1 / 3, abs=0.05)


def test_shares_are_linear_between_the_distances_and_constant_beyond():
    at_m = torch.tensor([0.0, 2.0, 3.5, 10.0, 39.0, 90.0], dtype=torch.float64)
    shares = shares_of("distance", at_m)
    assert shares.sum(dim=1) == pytest.approx(torch.ones(6).double())
    knots_m = torch.tensor(KNOTS_M, dtype=torch.float64)
    assert shares @ knots_m == pytest.approx(at_m.clamp(KNOTS_M[0], KNOTS_M[-1]))


@pytest.mark.parametrize("kind", ["temperature", "vector", "distance"])
def test_a_calibrator_computes_what_was_fitted(kind):
    facts = fitted(kind, *too_sure(lambda distance_m: 1 + distance_m / 20))
    logits = torch.randn(2, NUM_CLASSES, *GRID.shape, generator=torch.Generator().manual_seed(1))
    calibrated = Calibrator.of(GRID, facts)(logits)

    voxel = (5, 1, 0)
    shares = shares_of(kind, GRID.centers(torch.float64)[voxel].norm())
    scale, shift = (shares @ torch.tensor(facts[key]).double() for key in ("scale", "shift"))
    expected = scale * logits[(1, slice(None), *voxel)] + shift
    assert calibrated[(1, slice(None), *voxel)] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("kind", "broken", "told"),
    [
        ("vector", lambda each: each[:0], "no known voxel"),
        ("vector", lambda each: each * torch.inf if each.ndim == 2 else each, "NaN or infinities"),
    ],
)
def test_what_cannot_be_fitted_is_refused(kind, broken, told):
    sample = map(broken, too_sure(torch.ones_like, voxels=50))
    with pytest.raises(UserError, match=told):
        fitted(kind, *sample)


def test_numbers_that_are_not_finite_are_refused():
    nan = [[float("nan")] * NUM_CLASSES]
    with pytest.raises(UserError, match="not finite"):
        Calibrator(GRID, "vector", nan, nan)
