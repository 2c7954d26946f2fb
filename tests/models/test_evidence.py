import torch

from src.geometry import VoxelGrid
from src.models.evidence import VoxelEvidence, places_along_rays
from src.models.sight import Sight
from src.ontology import CAR
from tests.models.synthetic import build_references, sure_sight

GRID = VoxelGrid((0, -1, 0), (2, 1, 4), (2, 2, 4))
DIM, HEIGHTS, BINS, WIDTH, HEIGHT = 6, 3, 8, 5, 4
CAR_17_M = sure_sight(17.0, (1, BINS, HEIGHT, WIDTH), CAR)


def references_at(depth_m, valid=None):
    """One pillar, all of whose references are at the pixel (9, 5) and at some depths."""
    pix = torch.tensor([9.0, 5.0]).expand(1, 1, HEIGHTS, 2)
    valid = torch.ones(1, 1, HEIGHTS, dtype=torch.bool) if valid is None else valid
    return build_references(pix, valid)._replace(depth_m=torch.tensor(depth_m)[None, None])


def build_evidence():
    torch.manual_seed(0)
    return VoxelEvidence(DIM, GRID, context=2)


def test_each_reference_is_told_whether_it_is_in_front_of_the_surface_on_it_or_behind():
    # The sixth of eight bins: from 13.5 to 22.6 m.
    references = references_at([5.0, 17.0, 40.0])
    evidence = build_evidence()(CAR_17_M, torch.zeros(1, DIM, 4, 5), references)[0, 0].detach()
    surface, free, hidden = evidence[:, -3:].T
    torch.testing.assert_close(free, torch.tensor([1.0, free[1], 0.0]))
    torch.testing.assert_close(hidden, torch.tensor([0.0, hidden[1], 1.0]))
    assert 0.1 < surface[1] < 0.5
    torch.testing.assert_close(surface[[0, 2]], torch.zeros(2))

    # Only on the surface there is anything of a class.
    classes = evidence[:, 2:11]
    torch.testing.assert_close(classes[:, CAR], surface)
    assert classes.sum() == classes[:, CAR].sum()


def test_the_feature_is_that_of_the_pixel_and_counts_as_far_as_the_surface_is_there():
    build, feature = build_evidence(), torch.zeros(1, DIM, HEIGHT, WIDTH)
    feature[0, :, 1, 2] = torch.arange(1.0, DIM + 1)
    evidence = build(CAR_17_M, feature, references_at([17.0, 17.0, 40.0]))[0, 0]
    expected = build.context(feature[0, :, 1, 2]) * evidence[0, -3]
    torch.testing.assert_close(evidence[0, :2], expected)
    assert not evidence[2, :2].any()


def test_what_is_not_in_view_has_no_evidence():
    valid = torch.tensor([[[True, False, True]]])
    references = references_at([17.0, 17.0, 17.0], valid)
    evidence = build_evidence()(CAR_17_M, torch.randn(1, DIM, HEIGHT, WIDTH), references)
    assert evidence[0, 0].any(dim=-1).tolist() == [True, False, True]


def test_the_depth_learns_from_where_the_references_want_the_surface():
    depth = (CAR_17_M.depth * 1e-4).requires_grad_()
    sight, feature = CAR_17_M._replace(depth=depth), torch.randn(1, DIM, HEIGHT, WIDTH)
    build_evidence()(sight, feature, references_at([5.0, 17.0, 40.0])).sum().backward()
    assert depth.grad[0, :, 1, 2].abs().sum() > 0
    depth.grad[0, :, 1, 2] = 0
    assert not depth.grad.any(), "no other pixel is asked"


def test_a_point_is_on_the_surface_in_front_of_it_or_behind():
    torch.manual_seed(0)
    sight = Sight(torch.zeros(2, 9, HEIGHT, WIDTH), torch.randn(2, BINS + 1, HEIGHT, WIDTH))
    pixel = torch.arange(2 * HEIGHT * WIDTH)
    places = places_along_rays(sight, pixel, torch.linspace(0.5, 90, len(pixel)), 1.0)
    torch.testing.assert_close(places.sum(dim=-1), torch.ones(len(pixel)))
    assert places.min() >= -1e-6

    halfway_m = torch.full((len(pixel) // 2,), 5.0)
    places = places_along_rays(CAR_17_M, pixel[: len(halfway_m)], halfway_m, 1.0)
    torch.testing.assert_close(places, torch.tensor([0.0, 1.0, 0.0]).expand_as(places))
