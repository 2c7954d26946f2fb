"""Missed objects against a flood by hand."""

from itertools import product

import pytest
import torch

from src.metrics import ObjectMiss
from src.ontology import CAR, FREE, GROUND, THIN_STRUCTURE
from tests.metrics.inputs import LINE, line, scores_of


def flooded(true, said, near, tolerance):
    """[class, whether missed] of all objects, by sets of cells."""
    everywhere = list(product(*map(range, true.shape)))
    cells = {c for c in everywhere if true[c] not in (255, FREE, GROUND)}
    counts = torch.zeros(9, 2, dtype=torch.int64)
    while cells:
        whole, edge = set(), {cells.pop()}
        while edge:
            whole |= edge
            steps = product(edge, product((-1, 0, 1), repeat=3))
            touch = {tuple(map(sum, zip(cell, step))) for cell, step in steps}
            edge = {c for c in cells & touch if true[c] == true[min(whole)]}
            cells -= edge
        if not any(near[c] for c in whole):
            continue
        seen = any(
            sum((a - b) ** 2 for a, b in zip(c, other)) <= tolerance**2
            for c, other in product(whole, everywhere)
            if true[other] in (true[c], FREE) and said[other] not in (FREE, GROUND)
        )
        counts[int(true[min(whole)]), int(not seen)] += 1
    return counts


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("tolerance", [0, 1, 1.5])
def test_the_count_is_that_of_a_flood(grid, random_batch, seed, tolerance):
    preds, target, velocity = random_batch(seed, frames=3)
    rng = torch.Generator().manual_seed(seed)
    sparse = torch.rand(target.shape, generator=rng) < 0.5
    target = torch.where(sparse | (target == 255), target, FREE)
    kept = torch.rand(target.shape, generator=rng) < torch.where(target == FREE, 0.05, 0.3)
    preds = torch.where(kept, torch.where(preds < 2, GROUND, preds), FREE)
    options = {"near_m": 8.0, "seconds": 2.0, "tolerance_m": tolerance * grid.voxel_m}
    objects = ObjectMiss(grid, **options).frame_counts(preds, target, velocity)["objects"]

    centers = grid.centers().double()
    for n in range(3):
        end = velocity[n].double() * 2.0
        along = (centers @ end / end.square().sum()).clamp(0, 1)
        near = (centers - along[..., None] * end).norm(dim=-1) <= 8.0
        assert objects[n].tolist() == flooded(target[n], preds[n], near, tolerance).tolist()
    assert objects.sum() > 0


def test_rates_are_shares_of_the_objects_met():
    """A prediction in the voxel beside a wire saves it, and one two voxels away does not."""
    ahead = torch.tensor([[5.0, 0.0, 0.0]])
    scores = scores_of(
        ObjectMiss(LINE, tolerance_m=2.0, seconds=2.0),
        (line(x1=CAR, x4=CAR), line(x1=CAR, x3=THIN_STRUCTURE), ahead),
        (line(x3=CAR), line(x5=THIN_STRUCTURE), ahead),
        (line(), line(x1=CAR), ahead),
    )
    assert scores["object_miss_rate"] == 0.5
    assert scores["object_miss_rate/car"] == 0.5
    assert scores["object_miss_rate/thin_structure"] == 0.5
    assert "object_miss_rate/ground" not in scores
