"""Primitive miss against the points of the paths, one by one; its curve by pairs."""

import math

import numpy as np
import pytest
import torch

from src.metrics import PrimitiveMiss
from src.metrics import functional as F
from src.ontology import BUILDING, CAR, FREE, THIN_STRUCTURE
from tests.metrics.inputs import LINE, assert_same, line, one_hot, random_logits, scores_of, updated

# ----------------------------------------------------------------------------------- the paths


@pytest.mark.parametrize("velocity", [(8.0, 0.0, 0.0), (3.0, -6.0, 2.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize(("turn", "climb"), [(0.0, 0.0), (45.0, -20.0), (-30.0, 10.0)])
def test_a_path_is_flown_in_small_steps(velocity, turn, climb):
    """A thousand steps a second, each in the direction in which the UAV flies then."""
    speed = 7.0
    (path,) = F.primitive_paths(torch.tensor(velocity), speed, [turn], [climb], 2.0, 0.5)
    heading, place = math.atan2(velocity[1], velocity[0]), np.zeros(3)
    for n in range(2000):
        angle = heading + math.radians(turn) * (n + 0.5) / 1000
        ahead = math.cos(math.radians(climb))
        step = (ahead * math.cos(angle), ahead * math.sin(angle), math.sin(math.radians(climb)))
        place += speed / 1000 * np.array(step)

    assert path[0].tolist() == [0, 0, 0]
    assert path[-1] == pytest.approx(place, abs=1e-4)
    assert np.linalg.norm(np.diff(path, axis=0), axis=-1).max() <= 0.5 + 1e-9


# ------------------------------------------------------------------------ against the points


def swept_by_points(grid, target, logits, path, radius_m):
    """Class met first, whether known, whether said, highest log-odds, of one path."""
    centers_m = grid.centers(torch.float64).flatten(0, -2)
    target, p = target.flatten(), logits.double().softmax(0).flatten(1)
    apart_m = torch.cdist(torch.from_numpy(path), centers_m)
    near = (apart_m <= radius_m) & (target != 255)
    swept = near.any(dim=0)
    met = 255
    for point, of_point in zip(apart_m, near & (target != FREE)):
        if met == 255 and of_point.any():
            met = int(target[point.where(of_point, torch.tensor(math.inf)).argmin()])
    odds = (1 - p[FREE]).log() - p[FREE].log()
    said = (p.argmax(0) != FREE)[swept].any()
    return met, swept.any(), said, max(odds[swept].tolist(), default=-math.inf)


@pytest.mark.parametrize("seed", [0, 1])
def test_what_a_path_sweeps_is_what_its_points_are_near(grid, random_batch, seed):
    _, target, velocity = random_batch(seed, frames=2)
    target = torch.where((target != 255) & (target != CAR), FREE, target)
    logits = random_logits(seed, target)
    for n in range(2):
        paths = F.primitive_paths(velocity[n], 9.0, [-40.0, 0.0, 25.0], [-15.0, 5.0], 2.0, 2.0)
        codes = F.encode(logits.argmax(1), target, None, 9, 255)[n]
        swept = F.swept(codes, logits[n], paths, 3.0, grid, FREE)
        for k, path in enumerate(paths):
            *expected, odds = swept_by_points(grid, target[n], logits[n], path, 3.0)
            assert [swept.met[k], swept.known[k], swept.said[k]] == expected
            assert float(swept.log_odds[k]) == pytest.approx(odds, abs=1e-4)


def test_the_curve_is_that_of_all_pairs(grid, random_batch):
    """The area is the chance that a blocked path scores above a clear one, ties counting half."""
    metric = PrimitiveMiss(grid, phantoms=0.25)
    rng = torch.Generator().manual_seed(0)
    blocked, clear = (torch.randint(0, 20, (256,), generator=rng) for _ in range(2))
    blocked[128:] += 15
    tables = {name: torch.zeros_like(table) for name, table in metric.counts.items()}
    tables["blocked"][CAR], tables["clear"] = blocked, clear
    scores = metric.scores(tables)

    bins = torch.arange(256)
    above = (bins[:, None] > bins) + 0.5 * (bins[:, None] == bins)
    pairs = blocked.double() @ above.double() @ clear.double()
    area = float(pairs / blocked.sum() / clear.sum())
    assert float(scores["primitive_auc"]) == pytest.approx(area)

    # Between thresholds, a threshold is drawn at random so that the share of phantoms is exact.
    share = [float(clear[n:].sum() / clear.sum()) for n in range(257)]
    found = [float(blocked[n:].sum() / blocked.sum()) for n in range(257)]
    expected = 1 - np.interp(0.25, share[::-1], found[::-1])
    assert float(scores["primitive_miss"]) == pytest.approx(expected)
    assert scores["primitive_miss/car"] == scores["primitive_miss"]
    assert scores["primitive_miss/building"].isnan()


# ------------------------------------------------------------------------------------ by hand


@pytest.mark.parametrize("seen", [False, True])
def test_a_wire_that_is_called_free_is_missed_and_one_that_is_seen_is_not(seen):
    """On the one path ahead, 10 m long; a second frame is free and seen so."""
    target = line(x2=THIN_STRUCTURE, x3=BUILDING)
    metric = PrimitiveMiss(LINE, turns_deg_per_s=[0.0], climbs_deg=[0.0])
    batches = [
        (8 * one_hot(said), true, torch.tensor([[1.0, 0.0, 0.0]]))
        for said, true in ((target if seen else line(), target), (line(), line()))
    ]
    scores = scores_of(metric, *batches)
    assert scores["primitive_miss_argmax"] == 1 - seen
    # As sure of the wire as of nothing, one finds as many wires as phantoms.
    assert scores["primitive_miss/thin_structure"] == pytest.approx(0 if seen else 0.99)
    assert scores["primitive_phantoms_argmax"] == 0
    assert scores["primitive_auc"] == (1 if seen else 0.5)


def test_labels_alone_have_both_shares_and_no_curve(grid, random_batch):
    preds, target, velocity = random_batch(0)
    logits = random_logits(0, target)
    by_labels = scores_of(PrimitiveMiss(grid), (logits.argmax(1), target, velocity))
    by_logits = scores_of(PrimitiveMiss(grid), (logits, target, velocity))
    assert by_labels == pytest.approx(
        {n: s if n.endswith("argmax") else math.nan for n, s in by_logits.items()}, nan_ok=True
    )

    beside = PrimitiveMiss(grid)
    beside.update(preds, target, velocity, logits=logits)
    whole = updated(PrimitiveMiss(grid), (logits, target, velocity))
    assert_same(beside.blocked, whole.blocked)
