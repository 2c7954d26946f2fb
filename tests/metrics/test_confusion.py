"""What both metrics share: exact accumulation, kinds of input, errors, the life of a Metric."""

import copy
import doctest
import importlib
import pickle

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import KARMeanIoU, OccupancyScores

BOTH = pytest.mark.parametrize("make", [KARMeanIoU, OccupancyScores])


def tables(metric):
    return torch.stack([metric.count, metric.excess])


def values(result):
    return torch.stack(list(result.values())) if isinstance(result, dict) else result


def same(a, b):
    return torch.equal(values(a).nan_to_num(-1), values(b).nan_to_num(-1))


def updated(make, grid, *batches):
    metric = make(grid)
    for batch in batches:
        metric.update(*batch)
    return metric


# ------------------------------------------------------------------------- exact accumulation


@BOTH
@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, random_batch, make, size):
    whole = random_batch(0, frames=11)
    splits = list(zip(*(tensor.split(size) for tensor in whole)))
    in_parts, at_once = updated(make, grid, *reversed(splits)), updated(make, grid, whole)
    assert torch.equal(tables(in_parts), tables(at_once))
    assert same(in_parts.compute(), at_once.compute())


@BOTH
def test_merged_states_equal_one_pass(grid, random_batch, make):
    a, b = random_batch(0), random_batch(1)
    merged = updated(make, grid, a)
    merged.merge_state(updated(make, grid, b))
    assert torch.equal(tables(merged), tables(updated(make, grid, a, b)))


def _score_a_rank(rank, address, batches, results):
    torch.distributed.init_process_group("gloo", init_method=address, rank=rank, world_size=2)
    grid = VoxelGrid((0, -10, -6), (24, 10, 6), (6, 5, 3))
    results[rank] = float(updated(KARMeanIoU, grid, *batches[rank::2]).compute())
    torch.distributed.destroy_process_group()


@pytest.mark.slow
def test_two_processes_score_as_one(grid, random_batch, tmp_path):
    batches = [random_batch(seed) for seed in range(3)]
    results = torch.multiprocessing.Manager().dict()
    arguments = (f"file://{tmp_path}/rendezvous", batches, results)
    torch.multiprocessing.spawn(_score_a_rank, arguments, nprocs=2)
    expected = float(updated(KARMeanIoU, grid, *batches).compute())
    assert dict(results) == {0: expected, 1: expected}


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_cuda_gives_the_same_bits(grid, random_batch):
    batch = random_batch(0)
    on_cuda = OccupancyScores(grid).cuda()
    on_cuda.update(*(tensor.cuda() for tensor in batch))
    assert torch.equal(tables(on_cuda).cpu(), tables(updated(OccupancyScores, grid, batch)))


def test_the_paper_grid_and_a_coarser_one_hold_every_voxel():
    for grid in (VoxelGrid(), VoxelGrid(shape=(25, 25, 15))):
        target = torch.zeros(1, *grid.shape, dtype=torch.uint8)
        metric = updated(KARMeanIoU, grid, (target, target, torch.ones(1)))
        assert int(metric.count[0, 0]) == target.numel()


# --------------------------------------------------------------------------------- input kinds


@pytest.mark.parametrize(
    "dtype", [torch.int8, torch.int16, torch.int32, torch.int64, torch.uint16, torch.uint32]
)
def test_labels_of_any_integer_dtype(grid, random_batch, dtype):
    preds, target, velocity = random_batch(0)
    expected = updated(KARMeanIoU, grid, (preds, target, velocity))
    metric = updated(KARMeanIoU, grid, (preds.to(dtype), target, velocity))
    assert torch.equal(tables(metric), tables(expected))
    if dtype != torch.int8:  # which cannot hold 255
        metric = updated(KARMeanIoU, grid, (preds, target.to(dtype), velocity))
        assert torch.equal(tables(metric), tables(expected))


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
def test_logits_score_as_the_labels_of_their_maximum(grid, random_batch, dtype):
    _, target, velocity = random_batch(0)
    rng = torch.Generator().manual_seed(5)
    logits = torch.randn(len(target), 9, *grid.shape, generator=rng).to(dtype).requires_grad_()
    by_logits = updated(KARMeanIoU, grid, (logits, target, velocity))
    by_labels = updated(KARMeanIoU, grid, (logits.argmax(1), target, velocity))
    assert torch.equal(tables(by_logits), tables(by_labels))
    assert not by_logits.compute().requires_grad


def test_strided_and_expanded_tensors(grid, random_batch):
    preds, target, velocity = random_batch(0)
    expected = updated(KARMeanIoU, grid, (preds[:1].repeat(4, 1, 1, 1), target, velocity))
    strided = target.transpose(1, 3).contiguous().transpose(1, 3)
    metric = updated(KARMeanIoU, grid, (preds[:1].expand(4, -1, -1, -1), strided, velocity))
    assert torch.equal(tables(metric), tables(expected))


def test_a_mask_is_the_same_as_unknown_labels(grid, random_batch):
    preds, target, velocity = random_batch(0)
    mask = torch.rand(target.shape, generator=torch.Generator().manual_seed(1)) < 0.5
    masked = updated(KARMeanIoU, grid, (preds, target, velocity, mask))
    unknown = updated(KARMeanIoU, grid, (preds, target.masked_fill(~mask, 255), velocity))
    assert torch.equal(tables(masked), tables(unknown))


def test_what_is_predicted_at_an_unknown_voxel_does_not_matter(grid, random_batch):
    preds, target, velocity = random_batch(0)
    expected = updated(KARMeanIoU, grid, (preds, target, velocity))
    for anything in (255, 9, 16, 128):
        other = preds.masked_fill(target == 255, anything)
        metric = updated(KARMeanIoU, grid, (other, target, velocity))
        assert torch.equal(tables(metric), tables(expected))


@BOTH
@pytest.mark.parametrize("how", ["unknown", "masked", "no frames"])
def test_a_batch_without_a_counted_voxel_changes_nothing(grid, random_batch, make, how):
    preds, target, velocity = random_batch(0)
    metric = updated(make, grid, (preds, target, velocity))
    before = tables(metric)
    if how == "unknown":
        metric.update(preds, torch.full_like(target, 255), velocity)
    elif how == "masked":
        metric.update(preds, target, velocity, torch.zeros_like(target, dtype=torch.bool))
    else:
        metric.update(preds[:0], target[:0], velocity[:0])
    assert torch.equal(tables(metric), before)


# -------------------------------------------------------------------------------------- errors


def _set(tensor, value):
    changed = tensor.clone()
    changed.view(-1)[7] = value
    return changed


BAD_BATCHES = {
    "target of another grid": ("target:", lambda p, t, v: (p[:, :5], t[:, :5], v)),
    "target without batch": ("target:", lambda p, t, v: (p[0], t[0], v[0])),
    "target of floats": ("target:", lambda p, t, v: (p, t.float(), v)),
    "target id 9": ("target:", lambda p, t, v: (p, _set(t, 9), v)),
    "target id 254": ("target:", lambda p, t, v: (p, _set(t, 254), v)),
    "target id -1": ("target:", lambda p, t, v: (p, _set(t.long(), -1), v)),
    "target id 264": ("target:", lambda p, t, v: (p, _set(t.long(), 264), v)),
    "preds of another batch": ("preds:", lambda p, t, v: (p[:2], t, v)),
    "preds of bools": ("preds:", lambda p, t, v: (p > 3, t, v)),
    "labels as floats": ("preds:", lambda p, t, v: (p.float(), t, v)),
    "logits of 8 classes": ("preds:", lambda p, t, v: (torch.zeros(4, 8, 6, 5, 3), t, v)),
    "logits with NaN": (
        "preds:",
        lambda p, t, v: (_set(torch.zeros(4, 9, 6, 5, 3), torch.nan), t, v),
    ),
    "preds id 9": ("preds:", lambda p, t, v: (p.fill_(9), t, v)),
    "preds id 255": ("preds:", lambda p, t, v: (p.fill_(255), t, v)),
    "preds id -1": ("preds:", lambda p, t, v: (p.long().fill_(-1), t, v)),
    "preds id 256": ("preds:", lambda p, t, v: (p.long().fill_(256), t, v)),
    "velocity of another batch": ("velocity:", lambda p, t, v: (p, t, v[:3])),
    "velocity in the plane": ("velocity:", lambda p, t, v: (p, t, v[:, :2])),
    "velocity with NaN": ("velocity:", lambda p, t, v: (p, t, _set(v, torch.nan))),
    "velocity with infinity": ("velocity:", lambda p, t, v: (p, t, _set(v, torch.inf))),
    "mask of bytes": ("mask:", lambda p, t, v: (p, t, v, t)),
    "mask of another shape": ("mask:", lambda p, t, v: (p, t, v, t[:1] > 0)),
    "another device": ("preds:", lambda p, t, v: (p.to("meta"), t, v)),
}


@BOTH
@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, random_batch, make, call, what):
    names, spoil = BAD_BATCHES[what]
    good = random_batch(0)
    metric = updated(make, grid, good)
    before, score = tables(metric), metric.compute()
    with pytest.raises(UserError, match=f"^{names}") as error:
        getattr(metric, call)(*spoil(*random_batch(1)))
    assert "\n" not in str(error.value)
    assert torch.equal(tables(metric), before)
    assert same(metric.compute(), score)


def test_255_is_a_bad_id_where_another_label_means_unknown(grid, random_batch):
    metric = KARMeanIoU(grid, ignore_index=-100)
    with pytest.raises(UserError, match=r"^target:.*0 to 8 or -100"):
        metric.update(*random_batch(0))


@pytest.mark.parametrize(
    "arguments",
    [
        {"num_classes": 16},
        {"num_classes": 1},
        {"free_index": 9},
        {"horizon_s": -1.0},
        {"decay_per_s": float("nan")},
        {"penalty_scale": -0.1},
        {"penalty_scale": float("inf")},
        {"min_speed_mps": 0.0},
    ],
)
def test_parameters_that_make_no_sense_are_refused_by_name(grid, arguments):
    with pytest.raises(UserError, match=f"^{next(iter(arguments))}:"):
        KARMeanIoU(grid, **arguments)


# ------------------------------------------------------------------------ life as a Metric


@BOTH
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_copy_goes_on_where_the_original_was(grid, random_batch, make, duplicate):
    a, b = random_batch(0), random_batch(1)
    other = duplicate(updated(make, grid, a))
    other.update(*b)
    assert same(other.compute(), updated(make, grid, a, b).compute())


@BOTH
def test_reset_forgets_everything(grid, random_batch, make):
    metric = updated(make, grid, random_batch(0))
    metric.reset()
    assert not tables(metric).any()
    metric.update(*random_batch(1))
    assert torch.equal(tables(metric), tables(updated(make, grid, random_batch(1))))


@BOTH
def test_forward_gives_the_score_of_the_batch_and_accumulates(grid, random_batch, make):
    a, b = random_batch(0), random_batch(1)
    metric = make(grid)
    metric(*a)
    assert same(metric(*b), updated(make, grid, b).compute())
    assert same(metric.compute(), updated(make, grid, a, b).compute())


def test_a_cast_to_half_precision_changes_no_bit(grid, random_batch):
    expected = updated(KARMeanIoU, grid, random_batch(0))
    metric = KARMeanIoU(grid)
    metric.half().to(torch.bfloat16).update(*random_batch(0))
    assert torch.equal(tables(metric), tables(expected))


def test_a_checkpoint_holds_nothing_of_the_metric(grid):
    assert not KARMeanIoU(grid).state_dict()


@pytest.mark.parametrize(
    "name",
    [
        "functional.penalty",
        "kar",
        "occupancy",
        "breakdown",
        "safety",
        "calibration",
        "ray_iou",
        "sensitivity",
    ],
)
def test_the_examples_run(name):
    results = doctest.testmod(importlib.import_module(f"src.metrics.{name}"))
    assert results.attempted > 0
    assert results.failed == 0
