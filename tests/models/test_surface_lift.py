import torch

from src.models.evidence import TOLD
from src.models.surface_lift import SurfaceLift
from tests.models.synthetic import build_references

DIM, HEIGHTS, CONTEXT = 6, 3, 2


def test_a_pillar_is_the_mean_of_what_its_references_are_told_by_height():
    torch.manual_seed(0)
    lift = SurfaceLift(DIM, HEIGHTS, CONTEXT)
    valid = torch.tensor([[[True, False, True], [False, False, False]]])
    references = build_references(torch.zeros(1, 2, HEIGHTS, 2), valid)
    evidence = torch.randn(1, 2, HEIGHTS, CONTEXT + TOLD) * valid[..., None]

    pillars = lift(None, [], references, evidence)[0]
    by_height = [evidence[0, 0, height] @ lift.output[height] for height in (0, 2)]
    torch.testing.assert_close(pillars[0], (by_height[0] + by_height[1]) / 2)
    assert not pillars[1].any(), "no reference, exactly zero"
