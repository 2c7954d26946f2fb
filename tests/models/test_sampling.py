import math

import pytest
import torch

from src.models.sampling import SumOfRows, summed_by_bags, summed_by_grid

HEADS, POINTS, DIM = 2, 3, 4
SIZES = [(6, 9), (3, 5), (1, 1)]


def random_places(batch=2, places=7, seed=0):
    """Levels, x, y, weight and frame; some places are far outside, some on the edge."""
    generator = torch.Generator().manual_seed(seed)
    levels = [torch.randn(batch, h, w, DIM, generator=generator).double() for h, w in SIZES]
    shape = (HEADS, POINTS, len(SIZES), batch * places)
    x, y = (14 * torch.rand(shape, generator=generator).double() - 3 for _ in range(2))
    x[0, 0, :, 0], y[0, 0, :, 0] = 0.0, -1.0
    x[0, 1, :, 0], y[0, 1, :, 0] = -50.0, 1e4
    weight = torch.randn(shape, generator=generator).double()
    return levels, x, y, weight, torch.arange(batch).repeat_interleave(places)


def bilinear(feature, x, y):
    """Value at (x, y), integers at pixel centers, zeros outside: four corners, one by one."""
    total = torch.zeros(feature.shape[-1], dtype=feature.dtype)
    left, top = math.floor(x.detach()), math.floor(y.detach())
    for row in (top, top + 1):
        for column in (left, left + 1):
            if 0 <= row < feature.shape[0] and 0 <= column < feature.shape[1]:
                weight = (1 - (x - column).abs()) * (1 - (y - row).abs())
                total = total + weight * feature[row, column]
    return total


def summed_by_loops(levels, x, y, weight, frame):
    """The definition, one sample at a time."""
    heads, dim = x.shape[0], levels[0].shape[-1]
    out = torch.zeros(x.shape[-1], heads, dim // heads).double()
    for head, point, number, place in torch.cartesian_prod(*map(torch.arange, x.shape)).tolist():
        at = (head, point, number, place)
        values = levels[number][frame[place]].unflatten(-1, (heads, -1))[:, :, head]
        out[place, head] += weight[at] * bilinear(values, x[at], y[at])
    return out.flatten(1)


@pytest.mark.parametrize("summed", [summed_by_bags, summed_by_grid])
def test_it_equals_the_loops(summed):
    levels, *places = random_places()
    if summed is summed_by_bags:  # any number of places, in any order
        places = [each[..., [9, 2, 13, 2, 0]] for each in places]
    torch.testing.assert_close(summed(levels, *places), summed_by_loops(levels, *places))


def test_both_ways_have_the_same_gradients():
    levels, x, y, weight, frame = random_places()
    inputs = [t.requires_grad_() for t in (*levels, x, y, weight)]
    upstream = torch.randn(14, DIM, generator=torch.Generator().manual_seed(1)).double()
    bags, grid = (
        torch.autograd.grad(summed(levels, x, y, weight, frame), inputs, upstream)
        for summed in (summed_by_bags, summed_by_grid)
    )
    inside = (x.abs() < 10) & (y.abs() < 10) & (y != -1)
    for number, (a, b) in enumerate(zip(bags, grid)):
        if number in (3, 4):  # at a kink, and far outside, a slope means nothing
            a, b = a[inside], b[inside]
        torch.testing.assert_close(a, b)


def test_sum_of_rows_passes_gradcheck_with_repeated_and_unused_rows_and_empty_bags():
    generator = torch.Generator().manual_seed(0)
    rows = torch.randn(4, 3, generator=generator).double().requires_grad_()
    weights = torch.randn(5, generator=generator).double().requires_grad_()
    index = torch.tensor([2, 0, 2, 2, 3], dtype=torch.int32)
    offsets = torch.tensor([0, 0, 3, 3, 5, 5], dtype=torch.int32)

    def summed(rows, weights):
        return SumOfRows.apply(rows, index, weights, offsets)

    products = weights[:, None] * rows[index]
    nothing = torch.zeros(3).double()
    bags = [nothing, products[:3].sum(0), nothing, products[3:].sum(0), nothing]
    torch.testing.assert_close(summed(rows, weights), torch.stack(bags))
    assert torch.autograd.gradcheck(summed, (rows, weights))


def test_sum_of_rows_of_nothing():
    rows = torch.randn(4, 3, requires_grad=True)
    nothing = torch.zeros(0, dtype=torch.int32)
    out = SumOfRows.apply(rows, nothing, torch.zeros(0), torch.zeros(1, dtype=torch.int32))
    assert out.shape == (0, 3)

    out.sum().backward()
    assert rows.grad.eq(0).all()
