import torch

from src.models.attention import DeformableCrossAttention
from src.models.backbone import STRIDES
from src.models.bilinear_lift import BilinearLift
from tests.models.synthetic import build_references
from tests.models.test_attention import DIM, HEIGHTS, random_bilinear, random_input


def test_it_is_the_deformable_lift_that_has_learned_nothing():
    """Its one point is at the reference, and its weights are uniform."""
    query, features, references = random_input()
    lift = random_bilinear()
    other = DeformableCrossAttention(DIM, HEIGHTS, 2, num_points=1).double()
    other.value.weight.data = torch.eye(DIM).double()
    other.output = lift.output
    update = lift(query, features, references)
    torch.testing.assert_close(update, other(query, features, references), atol=1e-5, rtol=1e-5)


def test_the_query_has_no_say():
    lift = random_bilinear()
    query, features, references = random_input()
    assert lift(query + 1, features, references).equal(lift(query, features, references))


def test_a_spot_reaches_the_pillars_that_are_seen_there_and_no_other():
    lift = BilinearLift(DIM, HEIGHTS)
    query, features, references = random_input()
    features = [torch.zeros_like(f, dtype=torch.float32) for f in features]
    features[0][1, :, 6, 9] = 1.0
    references.pix[1, 3, 2] = torch.tensor([9.5 * 4, 6.5 * 4])
    references.pix[1, 1, 0] = torch.tensor([10.0 * 4, 6.0 * 4])
    from_spot = references.pix / 4 - 0.5 - torch.tensor([9, 6])
    valid = references.valid & (from_spot.abs() >= 1).any(dim=-1)
    valid[1, 3], valid[1, 1] = torch.arange(HEIGHTS) == 2, torch.arange(HEIGHTS) == 0
    update = lift(query, features, build_references(references.pix.float(), valid))
    torch.testing.assert_close(update[1, 3], lift.output[2].sum(0) / len(STRIDES))
    torch.testing.assert_close(update[1, 1], lift.output[0].sum(0) / len(STRIDES) / 4)
    assert update.ne(0).any(dim=-1).nonzero().tolist() == [[1, 1], [1, 3]]
