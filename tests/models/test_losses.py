import math
from functools import partial

import pytest
import torch

from src.errors import UserError
from src.models.losses import (
    OccupancyLoss,
    _lovasz_slope,
    cross_entropy,
    lovasz,
    safety_weights,
    supervised,
)
from src.ontology import BUILDING, FREE, GROUND, THIN_STRUCTURE, UNKNOWN, VRU
from tests.models.synthetic import build_loss


def random_case(seed=0, shape=(2, 3, 4, 5), classes=range(9), unknown=0.3):
    generator = torch.Generator().manual_seed(seed)
    logits = 3 * torch.randn(shape[0], 9, *shape[1:], generator=generator)
    picks = torch.randint(0, len(classes), shape, generator=generator)
    target = torch.tensor(list(classes), dtype=torch.uint8)[picks]
    target[torch.rand(shape, generator=generator) < unknown] = UNKNOWN
    return logits, target


def voxels(logits, target):
    """Every supervised voxel's logits (float64) and label, one at a time."""
    rows = logits.double().movedim(1, -1).flatten(0, -2)
    return [(row, int(label)) for row, label in zip(rows, target.flatten()) if label != UNKNOWN]


def slow_lovasz(logits, target):
    """The Lovász extension by its definition: the Jaccard loss of growing sets of errors."""
    cases = voxels(logits, target)
    losses = []
    for class_id in sorted({label for _, label in cases}):
        truth = {i for i, (_, label) in enumerate(cases) if label == class_id}
        probability = [row.softmax(0)[class_id] for row, _ in cases]
        errors = [1 - p if i in truth else p for i, p in enumerate(probability)]
        wrong, loss, before = set(), 0.0, 0.0
        for i in sorted(range(len(errors)), key=lambda i: -errors[i].item()):
            wrong.add(i)
            # Jaccard loss of a prediction that is wrong exactly on this set.
            jaccard = 1 - len(truth - wrong) / len(truth | wrong)
            loss = loss + errors[i] * (jaccard - before)
            before = jaccard
        losses.append(loss)
    return sum(losses) / len(losses)


@pytest.mark.parametrize("classes", [range(9), (GROUND, FREE), (VRU,)])
def test_lovasz_equals_its_definition_in_value_and_gradient(classes):
    logits, target = random_case(classes=classes)
    logits.requires_grad_()
    expected = slow_lovasz(logits, target)
    (expected_grad,) = torch.autograd.grad(expected, logits)
    loss = lovasz(*supervised(logits, target))
    (grad,) = torch.autograd.grad(loss, logits)
    torch.testing.assert_close(loss, expected.float())
    torch.testing.assert_close(grad, expected_grad, atol=1e-7, rtol=1e-4)


def test_lovasz_slopes_keep_their_precision_over_many_voxels():
    """Each slope, not only their sum: running Jaccard values in float32 would lose it."""
    generator = torch.Generator().manual_seed(0)
    error = torch.rand(300_000, generator=generator)
    is_class = torch.rand(len(error), generator=generator) < 0.9
    order = error.argsort(descending=True, stable=True)
    hits = is_class[order].double()
    intersection = hits.sum() - hits.cumsum(0)
    union = hits.sum() + (1 - hits).cumsum(0)
    jaccard = 1 - intersection / union
    expected = torch.empty_like(jaccard)
    expected[order] = torch.diff(jaccard, prepend=jaccard.new_zeros(1))
    unique = error.unique(return_inverse=True, return_counts=True)
    untied = unique[2][unique[1]] == 1
    expected[is_class] *= -1  # to the probability, which the error is 1 minus
    slope = _lovasz_slope(error, is_class, out=torch.empty_like(error)).double()
    torch.testing.assert_close(slope[untied], expected[untied], atol=0, rtol=1e-4)


def test_cross_entropy_divides_by_the_number_of_supervised_voxels():
    logits, target = random_case(seed=1)
    weight = torch.arange(1.0, 10.0)
    cases = voxels(logits, target)
    expected = sum(weight[label] * -row.log_softmax(0)[label] for row, label in cases) / len(cases)
    torch.testing.assert_close(cross_entropy(*supervised(logits, target), weight), expected.float())


def test_nothing_supervised_is_zero_with_a_graph():
    logits, target = random_case(unknown=2.0)
    logits.requires_grad_()
    parts = build_loss(torch.ones(9))(logits, target)
    assert set(parts) == {"cross_entropy", "lovasz", "total"}
    assert all(part == 0 for part in parts.values())
    parts["total"].backward()
    assert logits.grad.eq(0).all()


def test_total_is_cross_entropy_plus_weighted_lovasz():
    logits, target = random_case(seed=4)
    weight = torch.arange(1.0, 10.0)
    parts = build_loss(weight, 0.5)(logits, target)
    known = supervised(logits, target)
    total = cross_entropy(*known, weight) + 0.5 * lovasz(*known)
    torch.testing.assert_close(parts["total"], total)
    spoilt = torch.where(target[:, None] == UNKNOWN, torch.nan, logits)
    assert build_loss(weight, 0.5)(spoilt, target)["total"].equal(parts["total"])
    assert set(build_loss(weight, 0.0)(logits, target)) == {"cross_entropy", "total"}


def test_safety_weights_follow_their_rule():
    counts = torch.tensor([4e4, 1e5, 2.5e4, 100, 0, 1e3, 10, 4e3, 1e6])
    weight = safety_weights(counts, max_ratio=8.0, safety_factor=1.5).double()
    frequency = counts.double() / counts.double().sum()
    torch.testing.assert_close(frequency @ weight, torch.tensor(1.0, dtype=torch.float64))
    relative = (weight / weight[FREE]).tolist()
    assert relative[BUILDING] == pytest.approx(5.0)
    assert relative[GROUND] == pytest.approx(10**0.5)
    assert relative[THIN_STRUCTURE] == relative[VRU] == pytest.approx(12.0)
    assert relative[4] == pytest.approx(12.0), "a class that training lacks gets the cap"


@pytest.mark.parametrize("counts", [[0] * 9, [1] * 8, [1] * 8 + [-1]])
def test_safety_weights_refuse_what_are_no_counts(counts):
    with pytest.raises(UserError, match="voxel counts"):
        safety_weights(counts)
    terms = {"mine": partial(cross_entropy, class_weights=partial(safety_weights))}
    with pytest.raises(UserError, match=r"^loss\.terms\.mine\.class_weights: voxel counts"):
        OccupancyLoss(terms, counts)


def mean_margin(scores, labels, scale=1.0, offset=None):
    """A term of one's own: how far the label's score lies below the best one."""
    best = scores.max(dim=0).values - scores.gather(0, labels[None])[0]
    return scale * best.mean() + (0 if offset is None else offset.sum())


def test_a_term_of_ones_own_joins_the_sum_with_its_settings_and_class_counts():
    logits, target = random_case(seed=5)
    mine = partial(mean_margin, weight=0.25, scale=2.0, offset=partial(torch.tensor, dtype=float))
    loss = OccupancyLoss({"cross_entropy": cross_entropy, "mine": mine}, class_counts=[1] * 9)
    values = loss(logits, target)
    known = supervised(logits, target)
    own = mean_margin(*known, scale=2.0) + 9
    torch.testing.assert_close(values["mine"], own.double(), rtol=1e-6, atol=0)
    expected = cross_entropy(*known) + 0.25 * own
    torch.testing.assert_close(values["total"], expected.double(), rtol=1e-6, atol=0)
    assert loss.state_dict() == {}
    assert loss.to("meta").terms[1].offset.is_meta


@pytest.mark.parametrize(
    ("terms", "key"),
    [
        *(
            ({"mine": partial(lovasz, weight=weight)}, "mine.weight: ")
            for weight in (-1, math.nan, math.inf, "much", True)
        ),
        *((terms, ": ") for terms in ({}, {"mine": partial(lovasz, weight=0)})),
        *(({"mine": function}, "mine: ") for function in (None, {"weight": 1.0})),
        ({"total": lovasz}, "total: "),
        ({"mine": partial(mean_margin, scala=2.0)}, "mine.scala: .*'scale'"),
        ({"mine": partial(mean_margin, offset=partial(max))}, "mine.offset: "),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_what_is_no_sum_of_terms_is_refused_by_its_key(terms, key):
    with pytest.raises(UserError, match=rf"^loss\.terms\.?{key}"):
        OccupancyLoss(terms)


def test_class_weights_by_hand_are_nine_numbers():
    logits, target = random_case()
    weights = [1, 1, 1, 4, 3, 3, 5, 1, 0.5]
    found = OccupancyLoss({"own": partial(cross_entropy, class_weights=weights)})(logits, target)
    expected = cross_entropy(*supervised(logits, target), class_weights=torch.tensor(weights))
    torch.testing.assert_close(found["own"], expected)
    for wrong, told in (
        (weights[:8], "are 8; give 9 numbers of 0 or more"),
        ([*weights[:8], -1], "give 9 numbers"),
        ([0] * 9, "one of them above"),
        ([*weights[:8], "0.5"], "are no numbers"),
    ):
        with pytest.raises(UserError, match=rf"^loss\.terms\.own\.class_weights: .*{told}"):
            OccupancyLoss({"own": partial(cross_entropy, class_weights=wrong)})


def test_a_rule_of_class_weights_wants_a_cap_and_a_factor_that_make_weights():
    for wrong in ({"max_ratio": 0.5}, {"max_ratio": math.nan}, {"safety_factor": 0.0}):
        with pytest.raises(UserError, match=r"class_weights: max_ratio="):
            safety_weights([1] * 9, **wrong)


def test_a_term_must_give_one_number():
    logits, target = random_case()
    with pytest.raises(UserError, match=r"^loss\.terms\.mine: "):
        OccupancyLoss({"mine": lambda scores, labels: scores.mean(dim=0)})(logits, target)
