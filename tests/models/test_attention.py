"""The two lifts that sample the image at the references of the pillars: deformable and bilinear."""

from functools import partial

import pytest
import torch

from src.errors import UserError
from src.models.attention import DeformableCrossAttention
from src.models.backbone import STRIDES
from src.models.bilinear_lift import BilinearLift
from src.models.sampling import summed_by_grid
from tests.models.synthetic import build_references

DIM, HEIGHTS, HEADS, POINTS = 8, 3, 2, 2
WIDTH, HEIGHT = 96, 64


def random_attention():
    """Attention none of whose parameters is at its special initial value."""
    generator = torch.Generator().manual_seed(0)
    attention = DeformableCrossAttention(DIM, HEIGHTS, HEADS, POINTS).double()
    for parameter in attention.parameters():
        parameter.data = 0.7 * torch.randn(parameter.shape, generator=generator).double()
    return attention


def random_bilinear():
    torch.manual_seed(0)
    return BilinearLift(DIM, HEIGHTS).double()


def random_input():
    """Queries, features and references of two frames of five pillars, the first one unseen."""
    generator = torch.Generator().manual_seed(0)
    query = torch.randn(2, 5, DIM, generator=generator).double()
    features = [
        torch.randn(2, DIM, HEIGHT // s, WIDTH // s, generator=generator).double() for s in STRIDES
    ]
    # Some references lie on the image's edge, so that samples fall outside.
    pix = torch.rand(2, 5, HEIGHTS, 2, generator=generator).double()
    pix = (pix * 1.1 - 0.05).clamp(0, 0.9999) * torch.tensor([WIDTH, HEIGHT])
    valid = torch.rand(2, 5, HEIGHTS, generator=generator) < 0.6
    valid[0, 0] = False
    return query, features, build_references(pix, valid)


def slow_lift(module, query, features, references):
    """Eq. 8 written as loops, straight from its definition; without a query also the other lift."""
    levels = [feature.movedim(1, -1) for feature in features]
    if isinstance(module, DeformableCrossAttention):
        levels = [module.value(level) for level in levels]

    update = torch.zeros(*references.valid.shape[:2], DIM).double()
    for b, p, j in references.valid.nonzero().tolist():
        raw = torch.zeros(3, 1, 1, len(STRIDES), 1)
        if isinstance(module, DeformableCrossAttention):
            asked = query[min(b, len(query) - 1), p] + module.height_embedding[j]
            raw = module.sampling(asked).view(3, HEADS, POINTS, len(STRIDES), 1)
        x, y = (references.pix[b, p, j][:, None] / torch.tensor(STRIDES) - 0.5)[..., None]
        weight = raw[2].flatten(1).softmax(1).view_as(raw[2])
        maps = [level[b : b + 1] for level in levels]
        sampled = summed_by_grid(maps, x + raw[0], y + raw[1], weight, torch.zeros(1, dtype=int))
        update[b, p] += sampled[0] @ module.output[j] / references.valid[b, p].sum()
    return update


# In attention the sampling locations are float32.
@pytest.mark.parametrize(
    ("build", "queries", "tolerance"),
    [(random_attention, 1, 1e-4), (random_attention, 2, 1e-4), (random_bilinear, 2, 1e-7)],
    ids=["shared_query", "query_per_frame", "bilinear"],
)
def test_it_equals_the_loops_in_value_and_gradients(build, queries, tolerance):
    module = build()
    query, features, references = random_input()
    inputs = [query[:queries].requires_grad_(), *(f.requires_grad_() for f in features)]
    fast, slow = (
        lift(inputs[0], features, references) for lift in (module, partial(slow_lift, module))
    )
    torch.testing.assert_close(fast, slow, atol=tolerance, rtol=tolerance)
    assert fast.ne(0).any(dim=-1).equal(references.valid.any(dim=-1)), "exactly zero if unseen"

    inputs += list(module.parameters())
    upstream = torch.randn(2, 5, DIM, generator=torch.Generator().manual_seed(9)).double()
    gradients = (
        torch.autograd.grad(update, inputs, upstream, materialize_grads=True)
        for update in (fast, slow)
    )
    torch.testing.assert_close(*gradients, atol=10 * tolerance, rtol=10 * tolerance)


def test_deformable_attention_that_has_learned_nothing_is_the_bilinear_lift():
    """Its one point is at the reference, and its weights are uniform."""
    query, features, references = random_input()
    lift = random_bilinear()
    other = DeformableCrossAttention(DIM, HEIGHTS, HEADS, num_points=1).double()
    other.value.weight.data = torch.eye(DIM).double()
    other.output = lift.output
    update = lift(query, features, references)
    torch.testing.assert_close(update, other(query, features, references), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("build", [random_attention, random_bilinear])
@pytest.mark.parametrize("room", [5 * HEIGHTS, 12], ids=["room_for_all", "room_for_some_more"])
def test_neither_padding_nor_what_is_invalid_is_read(build, room):
    module = build()
    query, features, references = random_input()
    spoilt = references.pix.where(references.valid[..., None], torch.nan)
    padded = build_references(spoilt, references.valid, room)
    assert len(padded.in_view) == 2 * room
    inputs = [each.requires_grad_() for each in (query, *features)] + list(module.parameters())
    gradients = []
    for some in (references, padded):
        update = module(query, features, some)
        # Without a query, as in the bilinear lift, its gradient is zero.
        of_inputs = torch.autograd.grad(update.square().sum(), inputs, materialize_grads=True)
        gradients.append([update, *of_inputs])

    # Inside, places and weights are float32: a gradient is a sum over all that is sampled, whose
    # order depends on how many places there are.
    terms = len(padded.in_view) * HEADS * POINTS * len(STRIDES)
    for plain, with_room in zip(*gradients):
        atol = terms * torch.finfo(torch.float32).eps * plain.abs().max().item()
        torch.testing.assert_close(with_room, plain, atol=atol, rtol=0)


def test_heads_must_divide_the_width():
    with pytest.raises(UserError, match=r"size\.heads: 4 .*size\.dim, 10"):
        DeformableCrossAttention(10, HEIGHTS, 4, 1)
