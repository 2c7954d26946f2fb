"""How well a doubt orders voxels is what comparing every pair of them gives."""

import pytest
import torch

from studies.uncertainty.doubts import LEVELS, SMALLEST, Counts, auroc, fpr_at


@pytest.fixture
def drawn():
    """Doubts of 400 voxels, of which some are missed and are doubted more."""
    rng = torch.Generator().manual_seed(0)
    missed = torch.rand(400, generator=rng) < 0.2
    doubt = torch.sigmoid(torch.randn(400, generator=rng) - 2 + 1.5 * missed)
    return doubt, missed


def rows_of(doubt, missed):
    counts = Counts()
    for part in range(2):  # frames are added one by one
        counts.add("tube", "mine", doubt[part::2], missed[part::2])
    [row] = counts.rows()
    return row


def test_auroc_is_the_share_of_pairs_in_the_right_order(drawn):
    doubt, missed = drawn
    pairs = (doubt[missed][:, None] > doubt[~missed]).double().mean()
    row = rows_of(doubt, missed)
    assert row["auroc"] == pytest.approx(float(pairs), abs=0.002)
    assert (row["missed"], row["free"]) == (int(missed.sum()), int((~missed).sum()))
    assert rows_of(-doubt + 1, missed)["auroc"] < 0.5 < row["auroc"]


def test_fpr_is_what_is_doubted_beside_95_of_100_missed_ones(drawn):
    doubt, missed = drawn
    threshold = doubt[missed].sort(descending=True).values[int(0.95 * missed.sum() + 0.999) - 1]
    expected = float((doubt[~missed] >= threshold).double().mean())
    assert rows_of(doubt, missed)["fpr95"] == pytest.approx(expected, abs=0.01)


def test_a_doubt_that_says_nothing_is_chance():
    missed = torch.arange(100) % 3 == 0
    assert rows_of(torch.full((100,), 0.3), missed)["auroc"] == 0.5


def test_tiny_doubts_are_told_apart():
    doubt = torch.tensor([1e-7, 2e-7, SMALLEST / 10, 1.0])
    assert rows_of(doubt, torch.tensor([False, True, False, True]))["auroc"] == 1


def test_all_missed_ones_at_the_top_cost_nothing():
    free, missed = torch.zeros(LEVELS), torch.zeros(LEVELS)
    free[3], missed[9] = 5, 5
    assert (auroc(free, missed), fpr_at(free, missed, 0.95)) == (1, 0)
