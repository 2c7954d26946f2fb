import torch

from src.geometry import VoxelGrid
from src.models.sight import Sight
from src.models.surface_lift import SurfaceLift
from src.ontology import CAR
from tests.models.synthetic import build_references

GRID = VoxelGrid((0, -1, 0), (2, 1, 4), (2, 2, 4))
DIM, HEIGHTS, BINS, WIDTH, HEIGHT = 6, 3, 8, 5, 4


def sight_of(seen_bin=5):
    """A frame whose pixels see a car in one bin of the depth."""
    depth = torch.where(torch.arange(BINS + 1) == seen_bin, 1e4, 0.0)
    classes = torch.where(torch.arange(9) == CAR, 1e4, 0.0)
    maps = (x[None, :, None, None].expand(1, -1, HEIGHT, WIDTH).clone() for x in (classes, depth))
    return Sight(*maps)


def references_at(depth_m, valid=None):
    """One pillar, all of whose references are at the pixel (9, 5) and at some depths."""
    pix = torch.tensor([9.0, 5.0]).expand(1, 1, HEIGHTS, 2)
    valid = torch.ones(1, 1, HEIGHTS, dtype=torch.bool) if valid is None else valid
    return build_references(pix, valid)._replace(depth_m=torch.tensor(depth_m)[None, None])


def lift_of():
    torch.manual_seed(0)
    return SurfaceLift(DIM, HEIGHTS, GRID, context=2)


def told(lift, references, sight, feature):
    """What each height gives to the pillar, by W_j that pass a number on each."""
    width = lift.output.shape[1]
    out = []
    for place in range(width):
        lift.output.data.zero_()
        lift.output.data[:, place, :HEIGHTS] = torch.eye(HEIGHTS)
        out.append(lift(None, [feature], references, sight)[0, 0, :HEIGHTS] * HEIGHTS)
    return torch.stack(out, dim=1).detach()


def test_each_height_is_told_whether_it_is_in_front_of_the_surface_on_it_or_behind():
    # The sixth of eight bins: from 13.5 to 22.6 m.
    heights = told(
        lift_of(), references_at([5.0, 17.0, 40.0]), sight_of(), torch.zeros(1, DIM, 4, 5)
    )
    surface, free, hidden = heights[:, -3:].T
    torch.testing.assert_close(free, torch.tensor([1.0, free[1], 0.0]))
    torch.testing.assert_close(hidden, torch.tensor([0.0, hidden[1], 1.0]))
    assert 0.1 < surface[1] < 0.5
    torch.testing.assert_close(surface[[0, 2]], torch.zeros(2))
    # Only on the surface there is anything of a class.
    classes = heights[:, 2:11]
    torch.testing.assert_close(classes[:, CAR], surface)
    assert classes.sum() == classes[:, CAR].sum()


def test_the_feature_is_that_of_the_pixel_and_counts_as_far_as_the_surface_is_there():
    lift, feature = lift_of(), torch.zeros(1, DIM, HEIGHT, WIDTH)
    feature[0, :, 1, 2] = torch.arange(1.0, DIM + 1)
    heights = told(lift, references_at([17.0, 17.0, 40.0]), sight_of(), feature)
    expected = lift.context(feature[0, :, 1, 2]) * heights[0, -3]
    torch.testing.assert_close(heights[0, :2], expected)
    assert not heights[2, :2].any()


def test_a_pillar_without_a_valid_reference_gets_exactly_zero():
    nothing = references_at([5.0, 17.0, 40.0], torch.zeros(1, 1, HEIGHTS, dtype=torch.bool))
    assert not lift_of()(None, [torch.randn(1, DIM, HEIGHT, WIDTH)], nothing, sight_of()).any()


def test_the_depth_learns_from_where_the_pillars_want_the_surface():
    sight = sight_of()
    depth = (sight.depth * 1e-4).requires_grad_()
    update = lift_of()(
        None,
        [torch.randn(1, DIM, 4, 5)],
        references_at([5.0, 17.0, 40.0]),
        sight._replace(depth=depth),
    )
    update.sum().backward()
    assert depth.grad[0, :, 1, 2].abs().sum() > 0
    depth.grad[0, :, 1, 2] = 0
    assert not depth.grad.any(), "no other pixel is asked"
