"""KARBreakdown against plain loops over voxels, and its parts against each other."""

import math
from itertools import pairwise, product

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import KARBreakdown, KARMeanIoU
from src.ontology import CAR, CLASSES, FREE
from tests.metrics.inputs import coins, scores_of, updated
from tests.metrics.loops import OTHER, PAPER, class_shares, counted_voxels, occupied_mean

TTC_S, DISTANCE_M = (1.0, 2.0, 3.0, 4.0, 5.0), (5.0, 10.0, 25.0)
LINE = VoxelGrid(lower_m=(0, -1, -1), upper_m=(60, 1, 1), shape=(30, 1, 1))  # 1, 3, 5 ... m away


def mean_share(voxels, missed=None, phantom=None):
    return occupied_mean(class_shares(voxels, missed, phantom))


def expected_scores(every, ttc_s, distance_m):
    scores = {}
    for scope, voxels in {"all": every, "visible": [v for v in every if v.seen]}.items():
        whole = {
            "miou_occupied": mean_share(voxels, 0, 0),
            "kar_miou": mean_share(voxels, 1, 1),
            "ttc_cost": mean_share(voxels, 0, 0) - mean_share(voxels, 1, 1),
            "kar_miou_fp": mean_share(voxels, 0, 1),
            "kar_miou_fn": mean_share(voxels, 1, 0),
            "kar_precision": mean_share(voxels, None, 1),
            "kar_recall": mean_share(voxels, 1, None),
        }
        parts = {}
        for a, b in pairwise([0.0, *ttc_s, math.inf]):
            parts[f"ttc_{a:g}_{b:g}s"] = [v for v in voxels if a < v.ttc_s <= b]
        for a, b in pairwise([0.0, *distance_m, math.inf]):
            parts[f"distance_{a:g}_{b:g}m"] = [v for v in voxels if a < v.distance_m <= b]
        for b in distance_m:
            parts[f"within_{b:g}m"] = [v for v in voxels if v.distance_m <= b]
        for name, part in parts.items():
            whole[f"{name}/miou_occupied"] = mean_share(part, 0, 0)
            whole[f"{name}/kar_miou"] = mean_share(part, 1, 1)
        scores |= {f"{scope}/{name}": score for name, score in whole.items()}
    return scores


def check(grid, batch, visible, ttc_s=TTC_S, distance_m=DISTANCE_M, parameters=PAPER):
    voxels = counted_voxels(grid, batch, visible, parameters)
    expected = expected_scores(voxels, ttc_s, distance_m)
    parts = KARBreakdown(grid, ttc_edges_s=ttc_s, distance_edges_m=distance_m, **parameters)
    actual = scores_of(parts, (*batch, None, visible))
    assert actual == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return expected


# ------------------------------------------------------------------------- against the loops


@pytest.mark.parametrize("seed", range(3))
def test_every_score_matches_the_loops(grid, random_batch, seed):
    batch = random_batch(seed)
    expected = check(grid, batch, visible=coins(seed, batch[0]))
    assert expected["all/kar_miou"] != expected["visible/kar_miou"]


def test_other_edges_and_parameters_match_the_loops(grid, random_batch):
    batch = random_batch(4)
    check(grid, batch, coins(4, batch[0]), (0.5, 1.25), (7.0,), OTHER)


@pytest.mark.parametrize("lonely_m", [1, 9, 11, 25, 27])
def test_one_missed_car_is_in_the_bins_of_its_own_distance_only(lonely_m):
    target = torch.full((1, 30, 1, 1), FREE)
    target[0, lonely_m // 2] = CAR
    parts = KARBreakdown(LINE, ttc_edges_s=(1.0, 5.0), distance_edges_m=(9.0, 25.0))
    scores = scores_of(parts, (torch.full_like(target, FREE), target, torch.zeros(1, 3)))
    bins = {"ttc_0_1s": (0, 5), "ttc_1_5s": (5, 25), "ttc_5_infs": (25, math.inf)}
    bins |= {"distance_0_9m": (0, 9), "distance_9_25m": (9, 25), "distance_25_infm": (25, math.inf)}
    bins |= {"within_9m": (0, 9), "within_25m": (0, 25)}
    for name, (a, b) in bins.items():
        expected = 0.0 if a < lonely_m <= b else math.nan
        assert scores[f"all/{name}/kar_miou"] == pytest.approx(expected, nan_ok=True), name


# ------------------------------------------------------------------------- agreement and parts


@pytest.mark.parametrize("backend", ["auto", "numba", "torch"])
def test_the_whole_is_kar_miou_to_the_bit(grid, random_batch, backend):
    for seed in range(3):
        batch = random_batch(seed)
        parts, kar = KARBreakdown(grid, backend=backend), KARMeanIoU(grid, backend=backend)
        parts.update(*batch, visible=coins(seed, batch[0]))
        kar.update(*batch)
        assert torch.equal(parts.compute()["all/kar_miou"], kar.compute())


def test_without_visible_marks_all_visible_scores_are_nan(grid, random_batch):
    scores = scores_of(KARBreakdown(grid), random_batch(0))
    assert all(math.isnan(v) for name, v in scores.items() if name.startswith("visible/"))
    assert not math.isnan(scores["all/kar_miou"])


# ------------------------------------------------------------------------------------ the table


@pytest.fixture
def parts(grid, random_batch):
    """A metric that has counted `random_batch` 2."""
    preds, target, velocity = random_batch(2)
    return updated(KARBreakdown(grid), (preds, target, velocity, None, coins(2, target)))


def test_the_table_has_a_row_for_each_scope_part_and_class(parts):
    table = parts.table()
    assert list(table) == ["scope", "part", "class", "true_voxels", "iou", "kar_iou"]
    names = {name.split("/")[1] for name in parts.compute() if name.count("/") == 2}
    expected = set(product(("all", "visible"), {"whole", *names}, CLASSES))
    rows = list(zip(table["scope"], table["part"], table["class"]))
    assert set(rows) == expected
    assert len(rows) == len(expected) == 2 * (1 + 6 + 4 + 3) * 9


def test_the_true_voxels_are_those_of_the_target_and_those_of_the_parts_add_up(parts, random_batch):
    table = parts.table().set_index(["scope", "part", "class"])["true_voxels"]
    _, target, _ = random_batch(2)
    for n, name in enumerate(CLASSES):
        assert table["all", "whole", name] == int((target == n).sum())

    by_part = table.unstack("part")
    for kind in ("ttc_", "distance_"):
        bins = by_part[[name for name in by_part if name.startswith(kind)]]
        assert (bins.sum(axis=1) == by_part["whole"]).all()
    near = by_part[["distance_0_5m", "distance_5_10m"]].sum(axis=1)
    assert (by_part["within_10m"] == near).all()
    assert (by_part.loc["visible"] <= by_part.loc["all"]).all(axis=None)
    assert 0 < by_part.loc["visible", "whole"].sum() < by_part.loc["all", "whole"].sum()


def test_the_means_of_the_table_are_the_scores(parts):
    occupied = parts.table().query("`class` != 'free'")
    means = occupied.groupby(["scope", "part"])[["iou", "kar_iou"]].mean()
    scores = scores_of(parts)
    for (scope, part), row in means.iterrows():
        prefix = scope if part == "whole" else f"{scope}/{part}"
        actual = (scores[f"{prefix}/miou_occupied"], scores[f"{prefix}/kar_miou"])
        assert tuple(row) == pytest.approx(actual, abs=1e-6, nan_ok=True)
