"""KARBreakdown against plain loops over voxels, and its parts against each other."""

import math
from itertools import pairwise, product

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import KARBreakdown, KARMeanIoU
from src.ontology import CAR, CLASSES, FREE

PAPER = {"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0}
TTC_S, DISTANCE_M = (1.0, 2.0, 3.0, 4.0, 5.0), (5.0, 10.0, 25.0)
LINE = VoxelGrid(lower_m=(0, -1, -1), upper_m=(60, 1, 1), shape=(30, 1, 1))  # 1, 3, 5 ... m away


def coins(seed, like):
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(seed)) < 0.4


def counted_voxels(grid, batch, visible=None, mask=None, parameters=PAPER):
    """(target, prediction, excess penalty, ttc, distance, seen) of every counted voxel."""
    preds, target, velocity = batch
    voxels = []
    for b, *at in product(range(len(target)), *map(range, grid.shape)):
        x, y, z = at
        true = int(target[b, x, y, z])
        if true == 255 or (mask is not None and not mask[b, x, y, z]):
            continue
        centre_m = [low + (i + 0.5) * grid.voxel_m for low, i in zip(grid.lower_m, at)]
        distance_m = math.sqrt(sum(c * c for c in centre_m))
        speed_mps = math.sqrt(sum(v * v for v in velocity[b].tolist()))
        ttc_s = distance_m / max(speed_mps, parameters["min_speed_mps"])
        excess = parameters["penalty_scale"] * math.exp(-parameters["decay_per_s"] * ttc_s)
        excess = excess if ttc_s <= parameters["horizon_s"] else 0.0
        seen = visible is not None and bool(visible[b, x, y, z])
        voxels.append((true, int(preds[b, x, y, z]), excess, ttc_s, distance_m, seen))
    return voxels


def mean_share(voxels, missed=None, phantom=None):
    """Mean over occupied classes of TP / (TP + FN + FP); errors weigh 1 + factor * excess, and a
    factor of None leaves that kind out."""
    shares = []
    for c in range(FREE):
        hits = sum(t == p == c for t, p, *_ in voxels)
        whole = float(hits)
        for t, p, excess, *_ in voxels:
            if t != p and t == c and missed is not None:
                whole += 1 + missed * excess
            if t != p and p == c and phantom is not None:
                whole += 1 + phantom * excess
        if whole:
            shares.append(hits / whole)
    return sum(shares) / len(shares) if shares else math.nan


def expected_scores(every, ttc_s=TTC_S, distance_m=DISTANCE_M):
    scores = {}
    for scope, voxels in {"all": every, "visible": [v for v in every if v[5]]}.items():
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
            parts[f"ttc_{a:g}_{b:g}s"] = [v for v in voxels if a < v[3] <= b]
        for a, b in pairwise([0.0, *distance_m, math.inf]):
            parts[f"distance_{a:g}_{b:g}m"] = [v for v in voxels if a < v[4] <= b]
        for b in distance_m:
            parts[f"within_{b:g}m"] = [v for v in voxels if v[4] <= b]
        for name, part in parts.items():
            whole[f"{name}/miou_occupied"] = mean_share(part, 0, 0)
            whole[f"{name}/kar_miou"] = mean_share(part, 1, 1)
        scores |= {f"{scope}/{name}": score for name, score in whole.items()}
    return scores


def numbers(scores):
    return {name: float(score) for name, score in scores.items()}


def check(grid, batch, visible=None, mask=None, edges=(TTC_S, DISTANCE_M), parameters=PAPER):
    ttc_s, distance_m = edges
    parts = KARBreakdown(grid, ttc_edges_s=ttc_s, distance_edges_m=distance_m, **parameters)
    parts.update(*batch, mask, visible)
    expected = expected_scores(
        counted_voxels(grid, batch, visible, mask, parameters), ttc_s, distance_m
    )
    assert numbers(parts.compute()) == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return expected


def tables(metric):
    return torch.stack([metric.count, metric.excess])


# ------------------------------------------------------------------------- against the loops


@pytest.mark.parametrize("seed", range(3))
def test_every_score_matches_the_loops(grid, random_batch, seed):
    batch = random_batch(seed)
    expected = check(grid, batch, visible=coins(seed, batch[0]))
    assert expected["all/kar_miou"] != expected["visible/kar_miou"]


def test_other_edges_and_parameters_match_the_loops(grid, random_batch):
    batch = random_batch(4)
    other = {"horizon_s": 1.5, "decay_per_s": 0.1, "penalty_scale": 7.0, "min_speed_mps": 9.0}
    check(grid, batch, coins(4, batch[0]), None, ((0.5, 1.25), (7.0,)), other)


def test_a_mask_restricts_every_score(grid, random_batch):
    batch = random_batch(5)
    mask, visible = coins(0, batch[0]), coins(1, batch[0])
    assert check(grid, batch, visible, mask) != check(grid, batch, visible)


def test_times_and_distances_on_an_edge_belong_below_it(grid, random_batch):
    preds, target, velocity = random_batch(6)
    velocity[:] = torch.tensor([3.0, 0.0, 4.0])
    voxels = counted_voxels(grid, (preds, target, velocity))
    assert any(v[3] == 2.0 for v in voxels)
    assert any(v[4] == 10.0 for v in voxels)
    check(grid, (preds, target, velocity), coins(6, preds))


@pytest.mark.parametrize("lonely_m", [1, 9, 11, 25, 27])
def test_one_missed_car_is_in_the_bins_of_its_own_distance_only(lonely_m):
    target = torch.full((1, 30, 1, 1), FREE)
    target[0, lonely_m // 2] = CAR
    parts = KARBreakdown(LINE, ttc_edges_s=(1.0, 5.0), distance_edges_m=(9.0, 25.0))
    parts.update(torch.full_like(target, FREE), target, torch.zeros(1, 3))
    scores = numbers(parts.compute())
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


def test_both_backends_fill_equal_tables(grid, random_batch):
    preds, target, velocity = random_batch(0, frames=5)
    by_backend = []
    for backend in ("numba", "torch"):
        parts = KARBreakdown(grid, backend=backend)
        parts.update(preds, target, velocity, coins(2, preds), coins(3, preds))
        by_backend.append(tables(parts))
    assert torch.equal(*by_backend)
    assert by_backend[0].any()


def test_a_car_only_far_away_is_nan_within_the_near_range():
    target = torch.full((1, 30, 1, 1), FREE)
    target[0, 20:] = CAR
    parts = KARBreakdown(LINE)
    parts.update(target, target, torch.tensor([10.0]))
    scores = numbers(parts.compute())
    assert scores["all/kar_miou"] == 1.0
    assert scores["all/distance_25_infm/kar_miou"] == 1.0
    assert all(math.isnan(scores[f"all/within_{edge}m/kar_miou"]) for edge in (5, 10, 25))


def test_without_visible_marks_all_visible_scores_are_nan(grid, random_batch):
    parts = KARBreakdown(grid)
    parts.update(*random_batch(0))
    scores = numbers(parts.compute())
    assert all(math.isnan(v) for name, v in scores.items() if name.startswith("visible/"))
    assert not math.isnan(scores["all/kar_miou"])


def test_where_all_is_visible_both_scopes_agree(grid, random_batch):
    batch = random_batch(1)
    parts = KARBreakdown(grid)
    parts.update(*batch, visible=torch.ones_like(batch[0], dtype=torch.bool))
    scores = numbers(parts.compute())
    whole = {name[4:]: v for name, v in scores.items() if name.startswith("all/")}
    seen = {name[8:]: v for name, v in scores.items() if name.startswith("visible/")}
    assert seen == pytest.approx(whole, abs=0, nan_ok=True)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, random_batch, size):
    preds, target, velocity = random_batch(0, frames=7)
    batch = (preds, target, velocity, coins(0, preds), coins(1, preds))
    at_once, in_parts = KARBreakdown(grid), KARBreakdown(grid)
    at_once.update(*batch)
    for split in reversed(list(zip(*(tensor.split(size) for tensor in batch)))):
        in_parts.update(*split)
    assert torch.equal(tables(at_once), tables(in_parts))
    assert numbers(in_parts.compute()) == pytest.approx(
        numbers(at_once.compute()), abs=0, nan_ok=True
    )


# -------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize("name", ["ttc_edges_s", "distance_edges_m"])
@pytest.mark.parametrize("edges", [(), (0.0, 1.0), (-1.0,), (2.0, 1.0), (1.0, 1.0)])
def test_edges_that_are_not_ascending_are_refused_by_name(grid, name, edges):
    with pytest.raises(UserError, match=f"^{name}:"):
        KARBreakdown(grid, **{name: edges})


@pytest.mark.parametrize("name", ["ttc_edges_s", "distance_edges_m"])
@pytest.mark.parametrize("edges", [(math.nan,), (1.0, math.nan)])
def test_edges_that_are_not_a_number_are_refused_by_name(grid, name, edges):
    with pytest.raises(UserError, match=f"^{name}:"):
        KARBreakdown(grid, **{name: edges})


@pytest.mark.parametrize("call", ["update", "forward"])
def test_bad_visible_marks_are_refused_by_name_and_leave_the_state(grid, random_batch, call):
    batch = random_batch(0)
    parts = KARBreakdown(grid)
    parts.update(*batch)
    before = tables(parts)
    for bad in (batch[0], coins(0, batch[0])[:1]):
        with pytest.raises(UserError, match=r"^visible:"):
            getattr(parts, call)(*batch, visible=bad)
        assert torch.equal(tables(parts), before)


# ------------------------------------------------------------------------------------ the table


@pytest.fixture
def updated(grid, random_batch):
    batch = random_batch(2)
    parts = KARBreakdown(grid)
    parts.update(*batch, visible=coins(2, batch[0]))
    return parts


def test_the_table_has_a_row_for_each_scope_part_and_class(updated):
    table = updated.table()
    assert list(table) == ["scope", "part", "class", "true_voxels", "iou", "kar_iou"]
    names = {name.split("/")[1] for name in updated.compute() if name.count("/") == 2}
    expected = set(product(("all", "visible"), {"whole", *names}, CLASSES))
    rows = list(zip(table["scope"], table["part"], table["class"]))
    assert set(rows) == expected
    assert len(rows) == len(expected) == 2 * (1 + 6 + 4 + 3) * 9


def test_the_true_voxels_of_the_parts_add_up(updated):
    table = updated.table().set_index(["scope", "part", "class"])["true_voxels"]
    by_part = table.unstack("part")
    for kind in ("ttc_", "distance_"):
        bins = by_part[[name for name in by_part if name.startswith(kind)]]
        assert (bins.sum(axis=1) == by_part["whole"]).all()
    near = by_part[["distance_0_5m", "distance_5_10m"]].sum(axis=1)
    assert (by_part["within_10m"] == near).all()
    assert (by_part.loc["visible"] <= by_part.loc["all"]).all(axis=None)
    assert 0 < by_part.loc["visible", "whole"].sum() < by_part.loc["all", "whole"].sum()


def test_the_true_voxels_are_those_of_the_target(grid, random_batch):
    batch = random_batch(2)
    parts = KARBreakdown(grid)
    parts.update(*batch)
    table = parts.table().set_index(["scope", "part", "class"])["true_voxels"]
    for n, name in enumerate(CLASSES):
        assert table["all", "whole", name] == int((batch[1] == n).sum())


def test_the_means_of_the_table_are_the_scores(updated):
    occupied = updated.table().query("`class` != 'free'")
    means = occupied.groupby(["scope", "part"])[["iou", "kar_iou"]].mean()
    scores = numbers(updated.compute())
    for (scope, part), row in means.iterrows():
        prefix = scope if part == "whole" else f"{scope}/{part}"
        found = (scores[f"{prefix}/miou_occupied"], scores[f"{prefix}/kar_miou"])
        assert tuple(row) == pytest.approx(found, abs=1e-6, nan_ok=True)
