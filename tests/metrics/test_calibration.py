"""Calibration against plain loops, against cross entropy, and on predictors of known error."""

import math

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import Calibration
from src.ontology import CLASSES

CUBE = VoxelGrid((0, -5, -5), (10, 5, 5), (20, 20, 20))
LINE = VoxelGrid(lower_m=(0, -1, -1), upper_m=(20, 1, 1), shape=(10, 1, 1))  # 1, 3, 5 ... m away


def random_logits(seed, target, num_classes=9, scale=2.0):
    rng = torch.Generator().manual_seed(seed)
    size = (len(target), num_classes, *target.shape[1:])
    return scale * torch.randn(size, generator=rng)


@pytest.fixture
def batch(random_batch):
    """Logits, target, velocity."""
    _, target, velocity = random_batch(0)
    return random_logits(0, target), target, velocity


def coins(seed, like):
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(seed)) < 0.5


def scores_of(grid, *batches, **arguments):
    calibration = Calibration(grid, **arguments)
    for one in batches:
        calibration.update(*one)
    return {name: float(score) for name, score in calibration.compute().items()}


def counted_voxels(grid, target, velocity, mask=None, horizon_s=5.0, min_speed_mps=5.0):
    centre_m = grid.centers(torch.float64).tolist()
    for b, x, y, z in torch.nonzero(target != 255).tolist():
        radius_m = horizon_s * max(math.hypot(*velocity[b].tolist()), min_speed_mps)
        if math.hypot(*centre_m[x][y][z]) > radius_m or (mask is not None and not mask[b, x, y, z]):
            continue
        yield b, x, y, z


def ece_by_loops(voxels, bins):
    """Of (probability of the predicted class, whether it is right)."""
    gap = 0.0
    for n in range(bins):
        inside = [v for v in voxels if min(int(v[0] * bins), bins - 1) == n]
        if inside:
            gap += abs(sum(right for _, right in inside) - sum(p for p, _ in inside))
    return gap / len(voxels) if voxels else math.nan


def expected_scores(grid, logits, target, velocity, mask=None, bins=15, **bubble):
    voxels = []
    for b, x, y, z in counted_voxels(grid, target, velocity, mask, **bubble):
        row = logits[b, :, x, y, z].tolist()
        whole = sum(math.exp(one) for one in row)
        true, predicted = int(target[b, x, y, z]), row.index(max(row))
        nll = math.log(whole) - row[true]
        voxels.append((math.exp(row[predicted]) / whole, true == predicted, true, predicted, nll))

    def mean(values):
        return sum(values) / len(values) if values else math.nan

    scores = {"ece": ece_by_loops([v[:2] for v in voxels], bins)}
    scores["nll"] = mean([v[4] for v in voxels])
    for n, name in enumerate(CLASSES):
        scores[f"ece/{name}"] = ece_by_loops([v[:2] for v in voxels if v[3] == n], bins)
        scores[f"nll/{name}"] = mean([v[4] for v in voxels if v[2] == n])
    return scores


def state(calibration):
    return {name: table.clone() for name, table in calibration.tables.items()}


def same(a, b):
    return all(torch.equal(a[name], b[name]) for name in a)


# ------------------------------------------------------------------------- against the loops


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"bins": 1},
        {"bins": 4},
        {"horizon_s": 1.0},
        {"horizon_s": 0.7, "min_speed_mps": 14.0},
    ],
)
def test_every_score_matches_the_loops(grid, batch, arguments):
    expected = expected_scores(grid, *batch, **arguments)
    assert scores_of(grid, batch, **arguments) == pytest.approx(expected, abs=1e-5, nan_ok=True)


def test_a_mask_restricts_what_is_counted(grid, batch):
    masked = (*batch, coins(0, batch[1]))
    expected = expected_scores(grid, *masked)
    assert scores_of(grid, masked) == pytest.approx(expected, abs=1e-5, nan_ok=True)
    assert expected["ece"] != pytest.approx(expected_scores(grid, *batch)["ece"])


def test_nll_is_the_cross_entropy_of_the_counted_voxels(grid, batch):
    logits, target, velocity = batch
    counted = torch.zeros_like(target, dtype=torch.bool)
    for at in counted_voxels(grid, target, velocity, horizon_s=1.5):
        counted[at] = True
    assert 0 < counted.sum() < (target != 255).sum()
    rows, truth = logits.movedim(1, -1)[counted], target[counted].long()
    scores = scores_of(grid, batch, horizon_s=1.5)
    cross_entropy = torch.nn.functional.cross_entropy(rows, truth)
    assert scores["nll"] == pytest.approx(float(cross_entropy), abs=1e-5)
    for n, name in enumerate(CLASSES):
        of_class = torch.nn.functional.cross_entropy(rows[truth == n], truth[truth == n])
        assert scores[f"nll/{name}"] == pytest.approx(float(of_class), abs=1e-5, nan_ok=True)


# ----------------------------------------------------------------- predictors of known error


def drawn_from(logits, seed):
    p = logits.movedim(1, -1).flatten(0, -2).softmax(-1)
    drawn = torch.multinomial(p, 1, generator=torch.Generator().manual_seed(seed))
    return drawn.view(len(logits), *logits.shape[2:])


def test_a_calibrated_predictor_has_hardly_any_error():
    like = torch.zeros(2, *CUBE.shape)
    logits = random_logits(0, like, num_classes=4)
    target = drawn_from(logits, 1)
    scores = scores_of(CUBE, (logits, target, torch.ones(2)), num_classes=4)
    assert scores["ece"] < 0.02
    assert all(scores[f"ece/{n}"] < 0.04 for n in range(4))


def test_sharper_and_flatter_logits_than_the_truth_have_their_gap_as_error():
    like = torch.zeros(2, *CUBE.shape)
    logits = random_logits(0, like, num_classes=4)
    target = drawn_from(logits, 1)
    for factor, sign in ((4.0, 1), (0.25, -1)):
        confidence, predicted = (factor * logits).softmax(1).max(1)
        gap = float(confidence.mean() - (predicted == target).float().mean())
        scores = scores_of(CUBE, (factor * logits, target, torch.ones(2)), num_classes=4)
        assert sign * gap > 0.1
        assert scores["ece"] == pytest.approx(sign * gap, abs=0.01)


@pytest.mark.parametrize("right", [0, 6, 9, 10])
def test_saying_nine_tenths_costs_how_often_that_is_wrong(right):
    target = torch.zeros(1, *LINE.shape, dtype=torch.int64)
    target[0, :right] = 1
    logits = torch.tensor([0.1, 0.9]).log().view(1, 2, 1, 1, 1).expand(1, 2, *LINE.shape)
    scores = scores_of(LINE, (logits, target, torch.ones(1)), num_classes=2)
    assert scores["ece"] == pytest.approx(abs(0.9 - right / 10), abs=1e-6)
    assert scores["ece/1"] == scores["ece"]
    assert math.isnan(scores["ece/0"])
    nll = [-math.log(0.1) if right < 10 else math.nan, -math.log(0.9) if right else math.nan]
    assert [scores["nll/0"], scores["nll/1"]] == pytest.approx(nll, abs=1e-6, nan_ok=True)


def test_gaps_of_two_classes_that_cancel_in_a_bin_show_in_their_own_errors():
    target = torch.tensor([0] * 5 + [0] * 5).view(1, 10, 1, 1)
    logits = torch.zeros(1, 2, 10, 1, 1)
    logits[0, 0, :5], logits[0, 1, 5:] = 1e-4, 1e-4
    scores = scores_of(LINE, (logits, target, torch.ones(1)), num_classes=2)
    assert scores["ece"] == pytest.approx(0.0, abs=1e-3)
    assert (scores["ece/0"], scores["ece/1"]) == pytest.approx((0.5, 0.5), abs=1e-3)


# -------------------------------------------------------------------- bins, bubble and limits


def line_logits(p):
    """Two classes; the second has probability ``p`` everywhere."""
    logits = torch.tensor([1 - p, p], dtype=torch.float64).log()
    return logits.view(1, 2, 1, 1, 1).expand(1, 2, *LINE.shape)


def filled_bins(p, bins):
    calibration = Calibration(LINE, num_classes=2, bins=bins)
    target = torch.ones(1, *LINE.shape, dtype=torch.int64)
    calibration.update(line_logits(p), target, torch.ones(1))
    return torch.nonzero(calibration.reliability[:, :, 0].sum(0)).flatten().tolist()


@pytest.mark.parametrize(("p", "bin_"), [(1.0, 3), (0.76, 3), (0.74, 2), (0.51, 2)])
def test_a_probability_falls_into_its_bin_and_one_into_the_last(p, bin_):
    assert filled_bins(p, bins=4) == [bin_]


def test_a_probability_on_an_edge_belongs_above_it():
    assert filled_bins(0.5, bins=4) == [2]


def test_a_sure_and_right_predictor_has_no_error_at_all():
    target = torch.ones(1, *LINE.shape, dtype=torch.int64)
    scores = scores_of(LINE, (line_logits(1.0), target, torch.ones(1)), num_classes=2)
    assert (scores["ece"], scores["nll"]) == (0.0, 0.0)


def test_the_likelihood_of_a_sure_and_wrong_predictor_is_cut_off():
    target = torch.zeros(1, *LINE.shape, dtype=torch.int64)
    scores = scores_of(LINE, (line_logits(1.0), target, torch.ones(1)), num_classes=2)
    assert (scores["ece"], scores["nll"]) == (1.0, 64.0)


@pytest.mark.parametrize(("speed_mps", "inside"), [(0.0, 3), (5.0, 3), (7.0, 4), (1e9, 10)])
def test_only_voxels_in_the_bubble_count_and_its_edge_does(speed_mps, inside):
    calibration = Calibration(LINE, num_classes=2, horizon_s=1.0)
    target = torch.ones(1, *LINE.shape, dtype=torch.int64)
    calibration.update(line_logits(0.7), target, torch.tensor([speed_mps]))
    assert int(calibration.likelihood[:, 0].sum()) == inside
    assert int(calibration.reliability[..., 0].sum()) == inside


def test_what_lies_beyond_the_bubble_does_not_matter(grid, batch):
    logits, target, velocity = batch
    far = torch.ones_like(target, dtype=torch.bool)
    for at in counted_voxels(grid, target, velocity, horizon_s=1.0):
        far[at] = False
    other = torch.where(far[:, None], random_logits(7, target), logits)
    expected = scores_of(grid, batch, horizon_s=1.0)
    found = scores_of(grid, (other, target, velocity), horizon_s=1.0)
    assert found == pytest.approx(expected, abs=0, nan_ok=True)
    assert scores_of(grid, (other, target, velocity))["nll"] != scores_of(grid, batch)["nll"]


def test_nothing_counted_is_nan(grid, batch):
    logits, target, velocity = batch
    scores = scores_of(grid, (logits, torch.full_like(target, 255), velocity))
    assert all(math.isnan(score) for score in scores.values())
    scores = scores_of(grid, (logits[:0], target[:0], velocity[:0]))
    assert all(math.isnan(score) for score in scores.values())


# ------------------------------------------------------------------------------ input kinds


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.float16])
def test_logits_of_any_float_dtype(grid, batch, dtype):
    logits, target, velocity = batch
    logits = logits.to(dtype).requires_grad_()
    expected = scores_of(grid, (logits.detach().double(), target, velocity))
    assert scores_of(grid, (logits, target, velocity)) == pytest.approx(
        expected, abs=0, nan_ok=True
    )


@pytest.mark.parametrize("size", [1, 2, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, random_batch, size):
    _, target, velocity = random_batch(0, frames=7)
    whole = (random_logits(0, target), target, velocity, coins(0, target))
    at_once, in_parts = Calibration(grid), Calibration(grid)
    at_once.update(*whole)
    for split in reversed(list(zip(*(tensor.split(size) for tensor in whole)))):
        in_parts.update(*split)
    assert same(state(at_once), state(in_parts))
    assert at_once.reliability.any()


# -------------------------------------------------------------------------------------- errors


def one_nan(logits):
    spoiled = logits.clone()
    spoiled[0, 3, 0, 2, 1] = torch.nan
    return spoiled


BAD_BATCHES = {
    "labels": ("preds:.*logits", lambda x, t, v: (t, t, v)),
    "one NaN": ("preds:.*NaN", lambda x, t, v: (one_nan(x), t.clamp(max=8), v)),
    "all infinite": ("preds:", lambda x, t, v: (torch.full_like(x, torch.inf), t, v)),
    "8 classes": ("preds:", lambda x, t, v: (x[:, :8], t, v)),
    "logits of another batch": ("preds:", lambda x, t, v: (x[:2], t, v)),
    "target of another grid": ("target:", lambda x, t, v: (x, t[:, :5], v)),
    "target id 9": ("target:", lambda x, t, v: (x, t.fill_(9), v)),
    "target id -1": ("target:", lambda x, t, v: (x, t.long().fill_(-1), v)),
    "velocity of another batch": ("velocity:", lambda x, t, v: (x, t, v[:3])),
    "velocity with NaN": ("velocity:", lambda x, t, v: (x, t, v.fill_(torch.nan))),
    "mask of bytes": ("mask:", lambda x, t, v: (x, t, v, t)),
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, batch, call, what):
    names, spoil = BAD_BATCHES[what]
    calibration = Calibration(grid)
    calibration.update(*batch)
    before = state(calibration)
    with pytest.raises(UserError, match=f"^{names}"):
        getattr(calibration, call)(*spoil(*(tensor.clone() for tensor in batch)))
    assert same(state(calibration), before)
    assert calibration.update_count == 1


@pytest.mark.parametrize(
    "arguments", [{"bins": 0}, {"horizon_s": -1.0}, {"min_speed_mps": 0.0}, {"horizon_s": math.nan}]
)
def test_parameters_that_make_no_sense_are_refused_by_name(grid, arguments):
    with pytest.raises(UserError, match=f"^{next(iter(arguments))}:"):
        Calibration(grid, **arguments)


def test_a_class_that_also_means_unknown_is_refused_by_name(grid):
    with pytest.raises(UserError, match=r"^ignore_index:"):
        Calibration(grid, ignore_index=3)
