import pytest
import torch

from src.models.attention import DeformableCrossAttention
from src.models.backbone import STRIDES
from src.models.bilinear_lift import BilinearLift
from tests.models.synthetic import build_references
from tests.models.test_attention import DIM, HEIGHTS, bilinear, random_input


def random_lift(seed=0):
    torch.manual_seed(seed)
    return BilinearLift(DIM, HEIGHTS).double()


def slow_lift(lift, features, references):
    """The definition, one reference at a time."""
    frames, pillars = references.valid.shape[:2]
    update = torch.zeros(frames, pillars, DIM).double()
    for b, p in torch.cartesian_prod(torch.arange(frames), torch.arange(pillars)).tolist():
        seen = references.valid[b, p].nonzero()[:, 0].tolist()
        for j in seen:
            u, v = references.pix[b, p, j]
            values = [bilinear(f[b], u / s - 0.5, v / s - 0.5) for f, s in zip(features, STRIDES)]
            update[b, p] += torch.stack(values).mean(0) @ lift.output[j] / len(seen)
    return update


def test_it_equals_the_loops_in_value_and_gradients():
    lift = random_lift()
    query, features, references = random_input()
    inputs = [*(f.requires_grad_() for f in features), lift.output]
    fast, slow = lift(query, features, references), slow_lift(lift, features, references)
    torch.testing.assert_close(fast, slow)
    upstream = torch.randn(fast.shape, generator=torch.Generator().manual_seed(1)).double()
    torch.testing.assert_close(
        torch.autograd.grad(fast, inputs, upstream), torch.autograd.grad(slow, inputs, upstream)
    )


def test_it_is_the_deformable_lift_that_has_learned_nothing():
    """Whose one point is at the reference, and whose weights are uniform."""
    query, features, references = random_input()
    lift, other = random_lift(), DeformableCrossAttention(DIM, HEIGHTS, 2, num_points=1).double()
    other.value.weight.data = torch.eye(DIM).double()
    other.output = lift.output
    update = lift(query, features, references)
    torch.testing.assert_close(update, other(query, features, references), atol=1e-5, rtol=1e-5)


def test_the_query_has_no_say():
    lift = random_lift()
    query, features, references = random_input()
    assert lift(query + 1, features, references).equal(lift(query, features, references))


def test_a_pillar_without_valid_reference_gets_exactly_zero():
    query, features, references = random_input()
    update = random_lift()(query, features, references)
    assert update[0, 0].eq(0).all()
    assert update.ne(0).any(dim=-1).equal(references.valid.any(dim=-1))


def test_no_valid_reference_at_all_is_zero_with_finite_gradients():
    lift = random_lift()
    query, features, references = random_input()
    nothing = build_references(references.pix, torch.zeros_like(references.valid))
    update = lift(query, [f.requires_grad_() for f in features], nothing)
    assert update.eq(0).all()
    update.sum().backward()
    assert lift.output.grad.eq(0).all()
    assert all(f.grad.eq(0).all() for f in features)


@pytest.mark.parametrize("room", [5 * HEIGHTS, 12], ids=["room_for_all", "room_for_some_more"])
def test_padding_changes_nothing(room):
    lift = random_lift()
    query, features, references = random_input()
    unseen = references.pix.where(references.valid[..., None], torch.nan)
    padded = build_references(unseen, references.valid, room)
    assert len(padded.in_view) == 2 * room
    inputs = [*(f.requires_grad_() for f in features), lift.output]
    found = []
    for some in (references, padded):
        update = lift(query, features, some)
        found.append([update, *torch.autograd.grad(update.square().sum(), inputs)])
    torch.testing.assert_close(*found)


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


def test_bfloat16_autocast_stays_close():
    lift = random_lift().float()
    query, features, references = random_input()
    features = [f.float() for f in features]
    references = references._replace(pix=references.pix.float())
    plain = lift(query.float(), features, references)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = lift(query.float(), [f.bfloat16() for f in features], references)
    assert (mixed - plain).abs().mean() < 0.02 * plain.std()
