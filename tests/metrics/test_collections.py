"""Our metrics in torchmetrics' collections: each gives there what it gives alone."""

import copy
import pickle

import numpy as np
import pytest
import torch
from torchmetrics import MetricCollection

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import (
    Calibration,
    CameraRayIoU,
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
from src.metrics.count_metric import CountMetric
from tests.metrics.inputs import assert_same, random_logits, random_rays

GRID = VoxelGrid(lower_m=(0.0, -10.0, -6.0), upper_m=(24.0, 10.0, 6.0), shape=(6, 5, 3))
MADE = {
    "kar": lambda: KARMeanIoU(GRID),
    "unweighted": lambda: KARMeanIoU(GRID, penalty_scale=0.0),
    "slow": lambda: KARMeanIoU(GRID, min_speed_mps=1.0),
    "scores": lambda: OccupancyScores(GRID),
    "breakdown": lambda: KARBreakdown(GRID),
    "near": lambda: KARBreakdown(GRID, distance_edges_m=(4.0,)),
    "safety": lambda: SafetyScores(GRID, tube_radius_m=4.0),
    "wide": lambda: SafetyScores(GRID, tube_radius_m=6.0),
    "primitives": lambda: PrimitiveMiss(GRID, radius_m=4.0),
    "plans": lambda: PlanRegret(GRID, radius_m=4.0),
    "dear_plans": lambda: PlanRegret(GRID, radius_m=4.0, collision=5.0),
    "objects": lambda: ObjectMiss(GRID, near_m=4.0),
    "rays": lambda: CameraRayIoU(GRID, rays=(6, 4)),
    "far_rays": lambda: CameraRayIoU(GRID, rays=(6, 4), thresholds_m=(8.0,)),
    "own_rays": lambda: RayIoU(GRID),
    "near_rays": lambda: RayIoU(GRID, thresholds_m=(0.5,)),
    "calibration": lambda: Calibration(GRID),
    "few_bins": lambda: Calibration(GRID, bins=3),
    "occupied": lambda: OccupiedCalibration(GRID, tube_radius_m=4.0),
    "wide_occupied": lambda: OccupiedCalibration(GRID, tube_radius_m=6.0),
}


@pytest.fixture
def batches(random_batch):
    """Two batches by the names of arguments; in the first one every prediction is right."""

    def named(seed, right):
        preds, target, velocity = random_batch(seed)
        if right:
            preds = torch.where(target == 255, preds, target)
        ahead = torch.tensor([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
        return {
            "preds": preds,
            "target": target,
            "velocity": velocity,
            "visible": target < 4,
            "logits": random_logits(seed, preds),
            "occupied": random_logits(seed, preds)[:, 0].sigmoid(),
            **dict(zip(("origin_m", "directions"), random_rays(seed, len(preds)))),
            "camera_from_occ": ahead.expand(len(preds), 4, 4),
            "pix_from_camera": torch.tensor([[30.0, 0, 30], [0, 30, 20], [0, 0, 1]])[None].expand(
                len(preds), 3, 3
            ),
            "size_pix": (60, 40),
        }

    return [named(0, right=True), named(1, right=False)]


def taken(metric, batch):
    """The arguments of a batch that a metric takes."""
    return metric._filter_kwargs(**batch)


def alone(name, batches):
    metric = MADE[name]()
    for batch in batches:
        metric.update(**taken(metric, batch))
    return metric.compute()


def same(computed, expected):
    if isinstance(expected, dict):
        assert_same(computed, expected)
    else:
        torch.testing.assert_close(computed, expected, rtol=0, atol=0, equal_nan=True)


def parts_of(collection, name):
    """What one metric of a collection gives; a collection joins the dictionaries of several."""
    return collection[name].compute()


@pytest.mark.parametrize("groups", [True, False])
def test_each_gives_in_a_collection_what_it_gives_alone(batches, groups):
    """After a perfect batch the counts of metrics with other parameters are equal, and torchmetrics
    used to update only one of them from then on."""
    together = MetricCollection({n: make() for n, make in MADE.items()}, compute_groups=groups)
    for batch in batches:
        together.update(**batch)
    for name in MADE:
        same(parts_of(together, name), alone(name, batches))

    together.reset()
    together.update(**batches[1])
    for name in MADE:
        same(parts_of(together, name), alone(name, batches[1:]))


def test_the_report_s_smallest_case(random_batch):
    """KARMeanIoU with and without its penalty: 0.4455 for both, where the second one is 0.6500."""
    collection = MetricCollection({"a": KARMeanIoU(GRID), "b": KARMeanIoU(GRID, penalty_scale=0.0)})
    own = {"a": KARMeanIoU(GRID), "b": KARMeanIoU(GRID, penalty_scale=0.0)}
    preds, target, velocity = random_batch(0)
    for batch in ((torch.where(target == 255, preds, target), target, velocity), random_batch(1)):
        collection.update(*batch)
        for metric in own.values():
            metric.update(*batch)
    computed = collection.compute()
    assert computed == {name: metric.compute() for name, metric in own.items()}
    assert computed["a"] != computed["b"]


@pytest.mark.parametrize("groups", [True, False])
def test_forward_gives_the_batch_and_counts_it(batches, groups):
    together = MetricCollection({n: make() for n, make in MADE.items()}, compute_groups=groups)
    apart = {name: make() for name, make in MADE.items()}
    for batch in batches:
        of_batch = together(**batch)
        for name, metric in apart.items():
            expected = metric(**taken(metric, batch))
            found = of_batch[name] if name in of_batch else {k: of_batch.get(k) for k in expected}
            if not isinstance(expected, dict):
                same(found, expected)
    for name in MADE:
        same(parts_of(together, name), apart[name].compute())


@pytest.mark.parametrize("again", [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
def test_copied_and_pickled_collections_go_on(batches, again):
    together = MetricCollection({name: make() for name, make in MADE.items()})
    together.update(**batches[0])
    together = again(together)
    together.update(**batches[1])
    for name in MADE:
        same(parts_of(together, name), alone(name, batches))


@pytest.mark.parametrize("name", MADE)
def test_the_state_of_each_merges_into_one_made_alike(name, batches):
    both = [MADE[name](), MADE[name]()]
    for metric, batch in zip(both, batches):
        metric.update(**taken(metric, batch))
    both[0].merge_state(both[1])
    same(both[0].compute(), alone(name, batches))


def test_those_that_take_the_same_are_updated_by_position(random_batch):
    names = ("kar", "unweighted", "slow", "scores", "safety", "wide", "plans", "objects")
    together = MetricCollection({name: MADE[name]() for name in names})
    apart = {name: MADE[name]() for name in names}
    for batch in (random_batch(0), random_batch(1)):
        together.update(*batch)
        for metric in apart.values():
            metric.update(*batch)
    for name in names:
        same(parts_of(together, name), apart[name].compute())


def test_metrics_made_alike_merge_and_others_do_not(batches):
    alike = [KARMeanIoU(GRID), KARMeanIoU(GRID, 9, horizon_s=5)]
    for metric, batch in zip(alike, batches):
        metric.update(**taken(metric, batch))
    alike[0].merge_state(alike[1])
    assert alike[0].compute() == alone("kar", batches), "however the arguments are said"
    for other in (KARMeanIoU(GRID, horizon_s=4.0), SafetyScores(GRID)):
        with pytest.raises(UserError, match="made with other arguments"):
            alike[0].merge_state(other.metric_state)


class Near(CountMetric):
    """A user's own metric with a parameter: how many voxels are predicted below a class id."""

    def __init__(self, grid, below):
        super().__init__({"voxels": ()})
        self.below = below

    def frame_counts(self, preds):
        return {"voxels": (preds < self.below).flatten(1).sum(1)}

    def scores(self, counts):
        return {f"below_{self.below}": counts["voxels"]}


def test_a_metric_of_one_s_own_is_told_apart_too(batches):
    together = MetricCollection({"one": Near(GRID, 9), "other": Near(GRID, below=3)})
    first = dict(batches[0], preds=torch.zeros_like(batches[0]["preds"]))
    together.update(**first)
    together.update(**batches[1])
    assert together["one"].compute()["below_9"] > together["other"].compute()["below_3"]


def test_arrays_are_as_good_as_tensors(batches):
    arrays = {key: v.numpy() if isinstance(v, torch.Tensor) else v for key, v in batches[1].items()}
    arrays["preds"] = arrays["preds"].astype(">i4")[:, ::-1].copy()[:, ::-1]
    arrays["velocity"] = np.ascontiguousarray(arrays["velocity"][::-1])[::-1]
    for name in ("scores", "safety", "calibration", "rays"):
        metric = MADE[name]()
        metric.update(**taken(metric, arrays))
        same(metric.compute(), alone(name, batches[1:]))


def test_every_label_counts_where_none_is_ignored(random_batch):
    preds, target, velocity = random_batch(0)
    target = target.clamp(max=8)
    every, known = KARMeanIoU(GRID, ignore_index=None), KARMeanIoU(GRID)
    for metric in (every, known):
        metric.update(preds, target, velocity)
    assert every.compute() == known.compute()
    with pytest.raises(UserError, match=r"not 0 to 8$"):
        every.update(preds, target.clone().fill_(255), velocity)


def test_free_space_is_asked_for_where_the_classes_are_not_ours():
    with pytest.raises(UserError, match="free_index: which of the 12 classes"):
        KARMeanIoU(GRID, num_classes=12)
    assert KARMeanIoU(GRID, num_classes=12, free_index=8).free_index == 8
    assert KARMeanIoU(GRID).free_index == 8
    with pytest.raises(UserError, match="share one byte"):
        KARMeanIoU(GRID, num_classes=16, free_index=0)


def test_every_class_that_a_metric_names_is_asked_for():
    others = {"num_classes": 12, "free_index": 11}
    with pytest.raises(UserError, match="thin_index: which of the 12 classes"):
        SafetyScores(GRID, **others)
    with pytest.raises(UserError, match="ground_index: which of the 12 classes"):
        ObjectMiss(GRID, **others)
    assert SafetyScores(GRID, **others, thin_index=3).thin_index == 3


class Below(CountMetric):
    """A metric of a user's own, whose constructor hands on or holds whatever it is given."""

    def __init__(self, grid, table=None, **options):
        super().__init__({"voxels": ()})
        self.table = torch.ones(300) if table is None else torch.as_tensor(table)
        self.below = options.get("below", 9)

    def frame_counts(self, preds):
        return {
            "voxels": ((preds < self.below) * self.table[preds.long()]).flatten(1).sum(1).long()
        }

    def scores(self, counts):
        return {"voxels": counts["voxels"]}


@pytest.mark.parametrize("kind", ["options", "tensor", "array"])
def test_an_own_metric_s_counts_are_those_of_its_arguments(kind):
    """Long arrays are alike in text, which leaves out their middle."""
    table = torch.ones(3000)
    table[1500] = 7.0
    table = table.numpy() if kind == "array" else table
    other = {"below": 3} if kind == "options" else {"table": table}
    plain = {} if kind == "options" else {"table": torch.ones(3000)}
    marks = [set(Below(GRID, **each).metric_state) for each in (plain, other, other)]
    assert marks[0] != marks[1]
    assert marks[1] == marks[2]
