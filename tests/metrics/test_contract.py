"""What all metrics share: exact accumulation, kinds of input, errors, the life of a Metric."""

import copy
import doctest
import importlib
import math
import pickle
from pathlib import Path

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import (
    Calibration,
    KARBreakdown,
    KARMeanIoU,
    ObjectMiss,
    OccupancyScores,
    OccupiedCalibration,
    PlanRegret,
    PrimitiveMiss,
    RayIoU,
    SafetyScores,
)
from src.ontology import BUILDING, CAR, FREE, THIN_STRUCTURE
from tests.metrics.inputs import assert_same, coins, random_logits, updated

OPTIONS = {
    SafetyScores: {"tube_radius_m": 4.0},
    PrimitiveMiss: {"radius_m": 4.0},
    PlanRegret: {"radius_m": 4.0},
    ObjectMiss: {"near_m": 4.0},
    OccupiedCalibration: {"tube_radius_m": 4.0},
}
CONFUSIONS = (KARMeanIoU, OccupancyScores, KARBreakdown, SafetyScores)
ON_PATHS = (PlanRegret, ObjectMiss)
OF_VELOCITY = (*CONFUSIONS, Calibration, PrimitiveMiss, *ON_PATHS)
OF_LABELS = (*CONFUSIONS, RayIoU, *ON_PATHS)
EVERY = (*OF_LABELS, Calibration, PrimitiveMiss)
# One takes probabilities in place of predictions.
ALL = (*EVERY, OccupiedCalibration)
EXAMPLES = [path for path in Path("src/metrics").rglob("*.py") if ">>>" in path.read_text()]


def of(metrics):
    return pytest.mark.parametrize("make", metrics)


def counted(make, grid, *batches, **arguments):
    """A metric of this class that has counted the batches."""
    return updated(make(grid, **OPTIONS.get(make, {}), **arguments), *batches)


# ------------------------------------------------------------------------- exact accumulation


@of(ALL)
@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, batch_for, make, size):
    whole = batch_for(make, frames=11, masked=True)
    splits = list(zip(*(tensor.split(size) for tensor in whole)))
    in_parts, at_once = counted(make, grid, *reversed(splits)), counted(make, grid, whole)
    assert_same(in_parts.counts, at_once.counts)
    assert_same(in_parts.compute(), at_once.compute())
    assert all(table.any() for table in at_once.counts.values())


@of(ALL)
def test_merged_states_equal_one_pass(grid, batch_for, make):
    a, b = batch_for(make), batch_for(make, seed=1)
    merged = counted(make, grid, a)
    merged.merge_state(counted(make, grid, b))
    assert_same(merged.counts, counted(make, grid, a, b).counts)


def _score_a_rank(rank, address, batches, results):
    torch.distributed.init_process_group("gloo", init_method=address, rank=rank, world_size=2)
    grid = VoxelGrid((0, -10, -6), (24, 10, 6), (6, 5, 3))
    results[rank] = float(counted(KARMeanIoU, grid, *batches[rank::2]).compute())
    torch.distributed.destroy_process_group()


@pytest.mark.slow
def test_two_processes_score_as_one(grid, random_batch, tmp_path):
    batches = [random_batch(seed) for seed in range(3)]
    results = torch.multiprocessing.Manager().dict()
    arguments = (f"file://{tmp_path}/rendezvous", batches, results)
    torch.multiprocessing.spawn(_score_a_rank, arguments, nprocs=2)
    expected = float(counted(KARMeanIoU, grid, *batches).compute())
    assert dict(results) == {0: expected, 1: expected}


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_cuda_gives_the_same_bits(grid, random_batch):
    batch = random_batch(0)
    on_cuda = OccupancyScores(grid).cuda()
    on_cuda.update(*(tensor.cuda() for tensor in batch))
    actual = {name: table.cpu() for name, table in on_cuda.counts.items()}
    assert_same(actual, counted(OccupancyScores, grid, batch).counts)


@of(CONFUSIONS)
@pytest.mark.parametrize("of_logits", [False, True])
def test_both_backends_fill_equal_tables(grid, batch_for, make, of_logits):
    preds, *rest = batch_for(make, masked=True)
    batch = (random_logits(0, preds) if of_logits else preds, *rest)
    by_numba, by_torch = (counted(make, grid, batch, backend=b) for b in ("numba", "torch"))
    assert_same(by_numba.counts, by_torch.counts)


def test_the_paper_grid_and_a_coarser_one_hold_every_voxel():
    for grid in (VoxelGrid(), VoxelGrid(shape=(25, 25, 15))):
        target = torch.zeros(1, *grid.shape, dtype=torch.uint8)
        metric = counted(KARMeanIoU, grid, (target, target, torch.ones(1)))
        assert int(metric.count[0, 0]) == target.numel()


# --------------------------------------------------------------------------------- input kinds


@of(OF_LABELS)
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(
    "dtype", [torch.int8, torch.int16, torch.int32, torch.int64, torch.uint16, torch.uint32]
)
def test_labels_of_any_integer_dtype(grid, batch_for, make, dtype, masked):
    preds, target, *rest = batch_for(make, masked=masked)
    metric = counted(make, grid, (preds.to(dtype), target, *rest))
    assert_same(metric.counts, counted(make, grid, (preds, target, *rest)).counts)

    if dtype == torch.int8:  # which cannot hold 255
        target = target.clamp(max=FREE)
    expected = counted(make, grid, (preds, target, *rest))
    for labels in (preds, preds.to(dtype)):
        metric = counted(make, grid, (labels, target.to(dtype), *rest))
        assert_same(metric.counts, expected.counts)


@of(OF_LABELS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
def test_logits_score_as_the_labels_of_their_maximum(grid, batch_for, make, dtype):
    preds, *rest = batch_for(make)
    logits = random_logits(5, preds).to(dtype).requires_grad_()
    by_logits = counted(make, grid, (logits, *rest))
    assert_same(by_logits.counts, counted(make, grid, (logits.argmax(1), *rest)).counts)
    scores = by_logits.scores(by_logits.counts)
    assert not any(score.requires_grad for score in scores.values())


@of(ALL)
def test_strided_and_expanded_tensors(grid, batch_for, make):
    preds, target, *rest = batch_for(make)
    expanded = preds[:1].expand_as(preds)
    strided = target.transpose(1, 3).contiguous().transpose(1, 3)
    metric = counted(make, grid, (expanded, strided, *rest))
    expected = counted(make, grid, (expanded.contiguous(), target, *rest))
    assert_same(metric.counts, expected.counts)


@of(ALL)
def test_a_mask_is_the_same_as_unknown_labels(grid, batch_for, make):
    preds, target, *where = batch_for(make)
    mask = coins(1, target)
    visible = (coins(2, target),) if make is KARBreakdown else ()
    masked = counted(make, grid, (preds, target, *where, mask, *visible))
    unknown = target.masked_fill(~mask, 255)
    expected = counted(make, grid, (preds, unknown, *where, None, *visible))
    assert_same(masked.counts, expected.counts)
    whole = counted(make, grid, (preds, target, *where, None, *visible))
    assert any(not table.equal(masked.counts[name]) for name, table in whole.counts.items())


@of(ALL)
def test_another_label_may_mean_unknown(grid, batch_for, make):
    preds, target, *rest = batch_for(make, masked=True)
    other = torch.where(target == 255, -100, target.long())
    metric = counted(make, grid, (preds, other, *rest), ignore_index=-100)
    assert_same(metric.counts, counted(make, grid, (preds, target, *rest)).counts)


@of(OF_LABELS)
def test_what_is_predicted_at_an_unknown_voxel_does_not_matter(grid, batch_for, make):
    preds, target, *where = batch_for(make)
    expected = counted(make, grid, (preds, target, *where))
    for anything in (BUILDING, THIN_STRUCTURE, CAR, FREE, 9, 16, 128, 255):
        other = preds.masked_fill(target == 255, anything)
        assert_same(counted(make, grid, (other, target, *where)).counts, expected.counts)


UNCOUNTED = {
    "unknown": lambda p, t, v: (p, torch.full_like(t, 255), v),
    "masked": lambda p, t, v: (p, t, v, torch.zeros_like(t, dtype=torch.bool)),
    "no frames": lambda p, t, v: (p[:0], t[:0], v[:0]),
}


@of(OF_VELOCITY)
@pytest.mark.parametrize("how", UNCOUNTED)
def test_a_batch_without_a_counted_voxel_is_nan_and_changes_nothing(grid, batch_for, make, how):
    batch = batch_for(make)
    uncounted = UNCOUNTED[how](*batch)
    metric = counted(make, grid, uncounted)
    assert all(score.isnan() for score in metric.scores(metric.counts).values())
    both = counted(make, grid, batch, uncounted)
    assert_same(both.counts, counted(make, grid, batch).counts)


# -------------------------------------------------------------------------------------- errors


def _set(tensor, value):
    changed = tensor.clone()
    changed.view(-1)[7] = value
    return changed


def _logits(value, target, classes=9):
    return torch.full((len(target), classes, *target.shape[1:]), value)


BAD_BATCHES = {
    EVERY: {
        "target of another grid": ("target:", lambda p, t, *w: (p, t[:, :5], *w)),
        "target of floats": ("target:", lambda p, t, *w: (p, t.float(), *w)),
        "target id 9": ("target:", lambda p, t, *w: (p, _set(t, 9), *w)),
        "target id 254": ("target:", lambda p, t, *w: (p, _set(t, 254), *w)),
        "target id -1": ("target:", lambda p, t, *w: (p, _set(t.long(), -1), *w)),
        "target id 264": ("target:", lambda p, t, *w: (p, _set(t.long(), 264), *w)),
        "preds of another batch": ("preds:", lambda p, t, *w: (p[:2], t, *w)),
        "preds of bools": ("preds:", lambda p, t, *w: (p > 3, t, *w)),
        "logits of 8 classes": ("preds:", lambda p, t, *w: (_logits(0.0, t, 8), t, *w)),
        "a NaN": ("preds:.*NaN", lambda p, t, *w: (_set(_logits(0.0, t), math.nan), t, *w)),
        "mask of bytes": ("mask:", lambda p, t, *w: (p, t, *w, t)),
        "mask of another shape": ("mask:", lambda p, t, *w: (p, t, *w, t[:1] > 0)),
    },
    OF_LABELS: {
        "labels as floats": ("preds:.* labels are integers", lambda p, t, *w: (p.float(), t, *w)),
        "preds id 9": ("preds:", lambda p, t, *w: (p.fill_(9), t, *w)),
        "preds id 255": ("preds:", lambda p, t, *w: (p.fill_(255), t, *w)),
        "preds id -1": ("preds:", lambda p, t, *w: (p.long().fill_(-1), t, *w)),
        "preds id 256": ("preds:", lambda p, t, *w: (p.long().fill_(256), t, *w)),
    },
    OF_VELOCITY: {
        "velocity of another batch": ("velocity:", lambda p, t, v: (p, t, v[:3])),
        "velocity in the plane": ("velocity:", lambda p, t, v: (p, t, v[:, :2])),
        "velocity with NaN": ("velocity:", lambda p, t, v: (p, t, _set(v, math.nan))),
        "velocity with infinity": ("velocity:", lambda p, t, v: (p, t, _set(v, math.inf))),
    },
    CONFUSIONS: {"another device": ("preds:", lambda p, t, v: (p.to("meta"), t, v))},
    (KARMeanIoU, OccupancyScores): {
        "target without batch": ("target:", lambda p, t, v: (p[0], t[0], v[0])),
    },
    (KARBreakdown,): {
        "marks of bytes": ("visible:", lambda p, t, v: (p, t, v, None, t)),
        "marks of another shape": ("visible:", lambda p, t, v: (p, t, v, None, t[:1] > 0)),
    },
    (SafetyScores, PrimitiveMiss): {
        "speeds": ("velocity:.*not speeds", lambda p, t, v: (p, t, v.norm(dim=-1))),
    },
    (Calibration,): {
        "labels": ("preds:.*logits", lambda x, t, v: (t, t, v)),
    },
    (Calibration, PrimitiveMiss): {
        "all infinite": ("preds:", lambda x, t, v: (torch.full_like(x, math.inf), t, v)),
    },
    (RayIoU,): {
        "origins of another batch": ("rays:", lambda p, t, o, d: (p, t, o[:3], d)),
        "directions of another batch": ("rays:", lambda p, t, o, d: (p, t, o, d[:3])),
        "one direction a frame": ("rays:", lambda p, t, o, d: (p, t, o, d[:, 0])),
        "directions in the plane": ("rays:", lambda p, t, o, d: (p, t, o, d[..., :2])),
        "no direction": ("rays:", lambda p, t, o, d: (p, t, o, 0 * d)),
        "long directions": ("rays:", lambda p, t, o, d: (p, t, o, 1.001 * d)),
        "origin NaN": ("rays:", lambda p, t, o, d: (p, t, _set(o, math.nan), d)),
        "direction infinite": ("rays:", lambda p, t, o, d: (p, t, o, _set(d, math.inf))),
    },
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize(
    ("make", "names", "spoil"),
    [
        pytest.param(make, names, spoil, id=f"{make.__name__}-{what}")
        for metrics, bad in BAD_BATCHES.items()
        for what, (names, spoil) in bad.items()
        for make in metrics
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(
    grid, batch_for, make, call, names, spoil
):
    metric = counted(make, grid, batch_for(make))
    before = {name: table.clone() for name, table in metric.counts.items()}
    with pytest.raises(UserError, match=f"^{names}") as error:
        getattr(metric, call)(*spoil(*batch_for(make, seed=1)))
    assert "\n" not in str(error.value)
    assert_same(metric.counts, before)
    assert metric.update_count == 1


@of(ALL)
def test_255_is_a_bad_id_where_another_label_means_unknown(grid, batch_for, make):
    with pytest.raises(UserError, match=r"^target:.*0 to 8 or -100"):
        counted(make, grid, batch_for(make), ignore_index=-100)


BAD_ARGUMENTS = {
    ALL: [{"num_classes": 16}, {"num_classes": 1}, {"ignore_index": 3}],
    OF_LABELS: [{"free_index": 9}],
    (*CONFUSIONS, Calibration): [
        {"horizon_s": -1.0},
        {"horizon_s": math.nan},
        {"min_speed_mps": 0.0},
    ],
    CONFUSIONS: [{"decay_per_s": math.nan}, {"penalty_scale": -0.1}, {"penalty_scale": math.inf}],
    (KARBreakdown,): [
        {name: edges}
        for name in ("ttc_edges_s", "distance_edges_m")
        for edges in [(), (0.0, 1.0), (-1.0,), (2.0, 1.0), (1.0, 1.0), (math.nan,), (1.0, math.nan)]
    ],
    (SafetyScores,): [
        {"tube_radius_m": 0.0},
        {"tube_radius_m": math.nan},
        {"tube_s": -1.0},
        {"tube_s": math.inf},
        {"thin_index": 9},
        {"thin_index": -1},
        {"thin_tolerance": -1},
    ],
    (Calibration,): [{"bins": 0}],
    (PrimitiveMiss,): [
        *({name: value} for name in ("seconds", "radius_m") for value in (0.0, math.inf)),
        *({name: []} for name in ("turns_deg_per_s", "climbs_deg")),
        *({"turns_deg_per_s": [math.nan]}, {"min_speed_mps": -1.0}),
        *({"phantoms": share} for share in (0.0, 1.0)),
    ],
    (PlanRegret,): [{"collision": 1.0}, {"collision": math.nan}, {"seconds": 0.0}],
    (ObjectMiss,): [
        *({name: value} for name in ("near_m", "seconds") for value in (0.0, math.inf)),
        *({"tolerance_m": value} for value in (-0.1, math.nan)),
    ],
    (RayIoU,): [
        {"thresholds_m": thresholds_m}
        for thresholds_m in [(), (0.0,), (1.0, -2.0), (math.nan, 1.0)]
    ],
}


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (make, argument)
        for metrics, bad in BAD_ARGUMENTS.items()
        for argument in bad
        for make in metrics
    ],
)
def test_parameters_that_make_no_sense_are_refused_by_name(grid, make, argument):
    (name,) = argument
    with pytest.raises(UserError, match=f"^{name}:"):
        make(grid, **argument)


# ------------------------------------------------------------------------ life as a Metric


@of(ALL)
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_copy_goes_on_where_the_original_was(grid, batch_for, make, duplicate):
    a, b = batch_for(make), batch_for(make, seed=1)
    other = updated(duplicate(counted(make, grid, a)), b)
    assert_same(other.compute(), counted(make, grid, a, b).compute())


@of(ALL)
def test_reset_forgets_everything(grid, batch_for, make):
    metric = counted(make, grid, batch_for(make))
    metric.reset()
    assert not any(table.any() for table in metric.counts.values())
    metric.update(*batch_for(make, seed=1))
    assert_same(metric.counts, counted(make, grid, batch_for(make, seed=1)).counts)


@of(ALL)
def test_forward_gives_the_score_of_the_batch_and_accumulates(grid, batch_for, make):
    a, b = batch_for(make), batch_for(make, seed=1)
    metric = counted(make, grid)
    metric(*a)
    assert_same(metric(*b), counted(make, grid, b).compute())
    assert_same(metric.compute(), counted(make, grid, a, b).compute())


@of(ALL)
def test_a_cast_to_half_precision_changes_no_bit(grid, batch_for, make):
    metric = counted(make, grid).half().to(torch.bfloat16)
    metric.update(*batch_for(make))
    assert_same(metric.counts, counted(make, grid, batch_for(make)).counts)


@of(ALL)
def test_a_checkpoint_holds_nothing_of_the_metric(grid, make):
    assert not make(grid).state_dict()


@pytest.mark.parametrize("path", EXAMPLES, ids=str)
def test_the_examples_run(path):
    module = importlib.import_module(".".join(path.with_suffix("").parts))
    results = doctest.testmod(module)
    assert results.attempted > 0
    assert results.failed == 0
