"""KARBreakdown against plain loops over voxels, and its parts against each other."""

import math
from itertools import pairwise

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


def test_every_score_matches_the_loops(grid, random_batch):
    batch = random_batch(0)
    expected = check(grid, batch, visible=coins(0, batch[0]))
    assert expected["all/kar_miou"] != expected["visible/kar_miou"]
    batch = random_batch(4)
    check(grid, batch, coins(4, batch[0]), (0.5, 1.25), (7.0,), OTHER)


@pytest.mark.parametrize("lonely_m", [9, 11, 25])
def test_an_edge_belongs_to_the_bin_before_it(lonely_m):
    target = torch.full((1, *LINE.shape), FREE)
    target[0, lonely_m // 2] = CAR
    batch = torch.full_like(target, FREE), target, torch.zeros(1, 3)
    check(LINE, batch, target == CAR, (1.8, 5.0), (9.0, 25.0))


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_the_whole_is_kar_miou_to_the_bit_and_without_marks_nothing_is_visible(
    grid, random_batch, backend
):
    parts, kar = (make(grid, backend=backend) for make in (KARBreakdown, KARMeanIoU))
    scores = updated(parts, random_batch(0)).compute()
    assert torch.equal(scores["all/kar_miou"], updated(kar, random_batch(0)).compute())
    assert all(v.isnan() for name, v in scores.items() if name.startswith("visible/"))


def test_the_table_has_the_voxels_and_the_scores_of_each_scope_part_and_class(grid, random_batch):
    preds, target, velocity = random_batch(2)
    parts = updated(KARBreakdown(grid), (preds, target, velocity, None, coins(2, target)))
    table = parts.table().set_index(["scope", "part", "class"]).sort_index()
    assert len(table) == 2 * (1 + 6 + 4 + 3) * 9
    true_voxels = table["true_voxels"]["all", "whole"]
    assert true_voxels.to_dict() == {n: int((target == c).sum()) for c, n in enumerate(CLASSES)}

    scores = scores_of(parts)
    occupied = table.drop("free", level="class").groupby(["scope", "part"])
    for (scope, part), row in occupied[["iou", "kar_iou"]].mean().iterrows():
        prefix = scope if part == "whole" else f"{scope}/{part}"
        actual = (scores[f"{prefix}/miou_occupied"], scores[f"{prefix}/kar_miou"])
        assert tuple(row) == pytest.approx(actual, abs=1e-6, nan_ok=True)
