"""Two ways to the same sums: one is PyTorch's own sampling, and the reference of the other."""

import torch

from src.models.sampling import summed_by_bags, summed_by_grid

HEADS, POINTS, DIM = 2, 3, 4
SIZES = [(6, 9), (3, 5), (1, 1)]


def random_places(batch=2, places=7):
    """Levels, x, y, weight and frame; some places are far outside, some on the edge."""
    generator = torch.Generator().manual_seed(0)
    levels = [torch.randn(batch, h, w, DIM, generator=generator).double() for h, w in SIZES]
    shape = (HEADS, POINTS, len(SIZES), batch * places)
    x, y = (14 * torch.rand(shape, generator=generator).double() - 3 for _ in range(2))
    x[0, 0, :, 0], y[0, 0, :, 0] = 0.0, -1.0
    x[0, 1, :, 0], y[0, 1, :, 0] = -50.0, 1e4
    weight = torch.randn(shape, generator=generator).double()
    return levels, x, y, weight, torch.arange(batch).repeat_interleave(places)


def test_both_ways_give_the_same_sums_and_gradients():
    levels, x, y, weight, frame = random_places()
    inputs = [t.requires_grad_() for t in (*levels, x, y, weight)]
    bags, grid = (way(levels, x, y, weight, frame) for way in (summed_by_bags, summed_by_grid))
    torch.testing.assert_close(bags, grid)

    upstream = torch.randn(14, DIM, generator=torch.Generator().manual_seed(1)).double()
    gradients = [list(torch.autograd.grad(way, inputs, upstream)) for way in (bags, grid)]
    inside = (x.abs() < 10) & (y.abs() < 10) & (y != -1)
    for each in gradients:  # at a kink, and far outside, the slope of a place means nothing
        each[3:5] = each[3][inside], each[4][inside]
    torch.testing.assert_close(*gradients)


def test_what_is_not_a_number_is_summed_to_none():
    """As a loss it is told; as an index it would be a place of the memory."""
    levels, x, y, weight, frame = random_places()
    x[0, 0, :, 3] = torch.nan
    sums = summed_by_bags(levels, x, y, weight, frame)
    assert sums[3, : DIM // HEADS].isnan().all()
    assert sums[4:].isfinite().all()


def test_the_bags_take_any_number_of_places_in_any_order():
    levels, *places = random_places()
    chosen = [9, 2, 13, 2, 0]
    some = summed_by_bags(levels, *(each[..., chosen] for each in places))
    torch.testing.assert_close(some, summed_by_grid(levels, *places)[chosen])
