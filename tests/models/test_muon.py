"""Muon: orthogonal steps, and what stays with AdamW. `test_run` goes on from its state."""

import pytest
import torch

from src.models.muon import STEP_RMS, Muon, orthogonal


@pytest.mark.parametrize("shape", [(4, 9), (9, 4), (5, 5)])
def test_it_is_the_polar_factor(shape):
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    u, _, v = torch.linalg.svd(matrix, full_matrices=False)
    for polar in orthogonal([matrix, 1e-6 * matrix, matrix.T.contiguous().T]):
        torch.testing.assert_close(polar, u @ v, atol=5e-3, rtol=0)


def test_directions_without_a_gradient_stay():
    """A row of zeros, as of a class that is not in the batch, is not made of noise."""
    matrix = torch.tensor([[3.0, 4.0], [0.0, 0.0]])
    polar, zeros = orthogonal([matrix, torch.zeros(2, 3)])
    torch.testing.assert_close(polar, torch.tensor([[0.6, 0.8], [0.0, 0.0]]), atol=5e-3, rtol=0)
    assert not zeros.any()


def test_what_is_a_thousandth_counts_in_full_and_what_is_far_less_is_noise():
    generator = torch.Generator().manual_seed(0)
    u, _, v = torch.linalg.svd(torch.randn(6, 9, generator=generator), full_matrices=False)
    shares = torch.tensor([1.0, 0.3, 0.03, 0.002, 1e-5, 0.0])
    (polar,) = orthogonal([u @ torch.diag(shares) @ v])
    kept = (u.T @ polar @ v.T).diagonal()
    torch.testing.assert_close(kept[:4], torch.ones(4), atol=0.03, rtol=0)
    assert (kept[4:].abs() < 0.1).all()


def test_a_matrix_takes_steps_of_one_size_and_a_vector_stays_with_adamw():
    matrix, vector, alone = (torch.nn.Parameter(torch.ones(s)) for s in ((2, 3), (2,), (2,)))
    optimizer = Muon([matrix, vector], lr=0.1, weight_decay=0.0)
    adamw = torch.optim.AdamW([alone], lr=0.1, weight_decay=0.0)
    for each in (vector, alone):
        (matrix @ torch.tensor([1.0, 2.0, 3.0]) + 2 * each).square().sum().backward()
    adamw.step()
    optimizer.step()
    torch.testing.assert_close(vector, alone)

    # Both rows have the same gradient, so the step has one direction, whatever its length.
    moved = matrix.detach() - 1
    assert moved.norm().item() == pytest.approx(0.1 * STEP_RMS * 3**0.5, rel=1e-4)
