"""Missed objects against a flood by hand, and what an object is."""

from itertools import product

import pytest
import torch

from src.geometry import VoxelGrid
from src.metrics import ObjectMiss
from src.ontology import CAR, FREE, GROUND, THIN_STRUCTURE
from tests.metrics.inputs import scores_of, updated

HALF_METRES = VoxelGrid(lower_m=(0, -1, -1), upper_m=(4, 1, 1), shape=(8, 4, 4))
AHEAD = torch.tensor([[4.0, 0.0, 0.0]])
# The voxel whose center is a quarter of a metre above and to the left of the way.
LEFT, UP = 2, 2


def volume(**occupied):
    """Free labels of `HALF_METRES` with class ids at ``x<index>`` of the way."""
    labels = torch.full((1, *HALF_METRES.shape), FREE)
    for name, class_id in occupied.items():
        labels[0, int(name[1:]), LEFT, UP] = class_id
    return labels


def counted(preds, target, velocity=AHEAD, **options):
    return updated(ObjectMiss(HALF_METRES, **options), (preds, target, velocity)).objects


def flooded(codes_true, codes_said, near, tolerance):
    """[class, whether missed] of all objects, by sets of cells."""
    cells = {c for c in product(*map(range, codes_true.shape)) if codes_true[c] not in (255, FREE)}
    cells = {c for c in cells if codes_true[c] != GROUND}
    counts = torch.zeros(9, 2, dtype=torch.int64)
    while cells:
        whole, edge = set(), {cells.pop()}
        while edge:
            whole |= edge
            edge = {
                c
                for c in cells
                if any(
                    max(abs(a - b) for a, b in zip(c, e)) <= 1 and codes_true[c] == codes_true[e]
                    for e in edge
                )
            }
            cells -= edge
        if not any(near[c] for c in whole):
            continue
        said = any(
            sum((a - b) ** 2 for a, b in zip(c, other)) <= tolerance**2
            for c in whole
            for other in product(*map(range, codes_true.shape))
            if codes_true[other] in (codes_true[c], FREE)
            and codes_said[other] not in (FREE, GROUND)
        )
        counts[int(codes_true[next(iter(whole))]), int(not said)] += 1
    return counts


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("tolerance", [0, 1, 1.5])
def test_the_count_is_that_of_a_flood(grid, random_batch, seed, tolerance):
    preds, target, velocity = random_batch(seed, frames=3)
    rng = torch.Generator().manual_seed(seed)
    sparse = torch.rand(target.shape, generator=rng) < 0.3
    target = torch.where(sparse | (target == 255), target, FREE)
    preds = torch.where(torch.rand(target.shape, generator=rng) < 0.05, preds, FREE)
    options = {"near_m": 8.0, "seconds": 2.0, "tolerance_m": tolerance * grid.voxel_m}
    tables = ObjectMiss(grid, **options).frame_tables(preds, target, velocity)["objects"]

    centers = grid.centers().double()
    for n in range(3):
        end = velocity[n].double() * 2.0
        along = (centers @ end / end.square().sum()).clamp(0, 1)
        near = (centers - along[..., None] * end).norm(dim=-1) <= 8.0
        assert tables[n].tolist() == flooded(target[n], preds[n], near, tolerance).tolist()
    assert tables.sum() > 0


def test_a_wire_is_missed_until_a_voxel_half_a_metre_from_it_is_predicted():
    wire = volume(x4=THIN_STRUCTURE)
    assert counted(volume(), wire)[THIN_STRUCTURE].tolist() == [0, 1]
    assert counted(volume(x2=CAR), wire)[THIN_STRUCTURE].tolist() == [0, 1]
    for said in (volume(x4=CAR), volume(x3=CAR)):
        assert counted(said, wire)[THIN_STRUCTURE].tolist() == [1, 0]
    beside = volume()
    beside[0, 3, LEFT + 1, UP] = CAR
    assert counted(beside, wire)[THIN_STRUCTURE].tolist() == [0, 1]


def test_what_touches_by_a_corner_is_one_object_and_other_classes_are_others():
    target = volume(x1=CAR, x3=CAR, x5=CAR)
    target[0, 2, LEFT + 1, UP + 1] = CAR
    assert counted(volume(x1=CAR), target)[CAR].tolist() == [1, 1]
    target = volume(x1=CAR, x2=THIN_STRUCTURE)
    assert counted(volume(), target).sum(1).nonzero().flatten().tolist() == [THIN_STRUCTURE, CAR]


def test_the_ground_is_no_object_and_what_is_not_met_does_not_count():
    assert counted(volume(), volume(x4=GROUND)).sum() == 0
    behind = torch.tensor([[-4.0, 0.0, 0.0]])
    assert counted(volume(), volume(x6=CAR), behind).sum() == 0
    assert counted(volume(), volume(x6=CAR), near_m=0.2).sum() == 0
    assert counted(volume(), volume(x6=CAR), seconds=0.1, near_m=1.0).sum() == 0


def test_a_voxel_without_a_label_parts_objects_and_saves_none():
    target = volume(x3=CAR, x4=255, x5=CAR)
    assert counted(volume(x4=CAR), target)[CAR].tolist() == [0, 2]


def test_what_is_seen_of_the_ground_or_of_another_thing_saves_none():
    """A wire on the ground, beside a car that is seen."""
    target = volume(x3=GROUND, x4=THIN_STRUCTURE, x5=CAR)
    assert counted(volume(x3=GROUND, x5=CAR), target)[THIN_STRUCTURE].tolist() == [0, 1]
    assert counted(volume(x4=GROUND, x5=CAR), target)[THIN_STRUCTURE].tolist() == [0, 1]
    assert counted(volume(x4=CAR), target)[THIN_STRUCTURE].tolist() == [1, 0]


def test_rates_are_shares_of_the_objects_met():
    scores = scores_of(
        ObjectMiss(HALF_METRES),
        (volume(x1=CAR), volume(x1=CAR, x5=THIN_STRUCTURE), AHEAD),
        (volume(), volume(x1=CAR), AHEAD),
    )
    assert scores["object_miss_rate"] == pytest.approx(2 / 3)
    assert scores["object_miss_rate/car"] == 0.5
    assert scores["object_miss_rate/thin_structure"] == 1
    assert "object_miss_rate/ground" not in scores
