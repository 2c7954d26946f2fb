"""The priors: their counts, their labels, and the weight that validation chooses."""

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import OccupancyScores
from src.models.prior import CANDIDATES, VoxelPrior, seen_from

GRID = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
BUILDING, THIN, CAR, FREE, UNKNOWN = 0, 3, 5, 8, 255


def frames_of(*rows):
    return torch.tensor(rows, dtype=torch.uint8).reshape(len(rows), *GRID.shape)


def labels_of(prior, free_weight=None):
    return prior.labels(free_weight).flatten().tolist()


def prior_of(*rows, layers=(0, 0), at=0):
    prior = VoxelPrior(GRID.shape, layers)
    for frame in frames_of(*rows):
        prior.count(frame, at)
    return prior


def make_scores():
    return OccupancyScores(GRID)


def fitted(prior, *rows):
    """Every candidate's score on frames at 1 m/s in each direction."""
    frames = [(frame, torch.ones(3), 0) for frame in frames_of(*rows)]
    return prior.fit(frames, make_scores)


def test_the_majority_of_what_is_known_wins():
    prior = prior_of([BUILDING, CAR, FREE, UNKNOWN], [BUILDING, FREE, FREE, UNKNOWN])
    prior.count(frames_of([BUILDING, CAR, UNKNOWN, UNKNOWN])[0])
    expected = torch.zeros(9, *GRID.shape, dtype=torch.int32)
    expected[BUILDING, 0], expected[CAR, 1], expected[FREE, 1], expected[FREE, 2] = 3, 2, 1, 2
    assert torch.equal(prior.counts, expected)
    assert labels_of(prior) == [BUILDING, CAR, FREE, FREE], "free what was never labelled"
    assert (prior.labels().dtype, prior.labels().shape) == (torch.uint8, GRID.shape)


def test_a_rare_class_wins_only_when_free_weighs_little():
    prior = prior_of([THIN] * 4, *[[FREE] * 4] * 9)
    assert labels_of(prior, free_weight=1.0) == [FREE] * 4
    assert labels_of(prior, free_weight=0.12) == [FREE] * 4
    assert labels_of(prior, free_weight=0.11) == [THIN] * 4
    # And none invents an occupied voxel.
    only_free = prior_of([FREE, UNKNOWN, FREE, CAR])
    assert labels_of(only_free, free_weight=0.0) == [FREE] * 3 + [CAR]


def training_rows():
    """A car in a third of the frames in the first voxel, in 1 of 102 in the last two."""
    return [[CAR, FREE, CAR, CAR]] + [[CAR, FREE, FREE, FREE]] * 33 + [[FREE] * 4] * 68


def test_validation_chooses_the_weight_that_scores_best():
    prior = prior_of(*training_rows())
    often = [[CAR, FREE, FREE, FREE], [FREE, FREE, FREE, FREE]]
    results = fitted(prior, *often)
    assert tuple(results) == CANDIDATES
    assert labels_of(prior) == [CAR, FREE, FREE, FREE]
    assert results[prior.free_weight] == max(results.values()) > results[1.0]
    assert results[prior.free_weight] > results[min(CANDIDATES)]

    fitted(prior, *[[CAR, FREE, CAR, CAR]] * 2)
    assert labels_of(prior) == [CAR, FREE, CAR, CAR]


def test_the_results_are_the_scores_of_the_labels():
    prior, made = prior_of(*training_rows()), []
    target, velocity = frames_of([CAR, FREE, FREE, CAR]), torch.tensor([[9.0, 1.0, 0.0]])
    results = prior.fit(
        [(target[0], velocity[0], 0)], lambda: made.append(make_scores()) or made[-1]
    )
    for weight, kar_miou in results.items():
        scores = make_scores()
        scores.update(prior.labels(weight)[None], target, velocity)
        assert kar_miou == float(scores.compute()["kar_miou"])
    assert len(set(results.values())) == len(made) == 3, "what is the same is scored once"


def test_validation_without_an_occupied_voxel_is_refused():
    prior = prior_of([FREE] * 4)
    with pytest.raises(UserError, match="validation"):
        fitted(prior, [FREE] * 4)
    assert prior.free_weight == 1.0


# ----------------------------------------------------------------------------------- by the height


TALL = VoxelGrid(lower_m=(0, -1, -2), upper_m=(2, 1, 2), shape=(1, 1, 2))


def by_height(*frames):
    """A prior of frames of two voxels, one above the other, each with its layer."""
    prior = VoxelPrior(TALL.shape, (3, 6))
    for labels, layer in frames:
        prior.count(torch.tensor(labels, dtype=torch.uint8).view(TALL.shape), layer)
    return prior


def test_each_height_sees_its_part_and_one_beyond_the_nearest():
    labels = by_height(([BUILDING, FREE], 3), ([FREE, CAR], 4), ([THIN, FREE], 6)).labels()
    assert labels.flatten().tolist() == [BUILDING, FREE, CAR, THIN, FREE]
    seen = {layer: seen_from(labels, layer - 3, 2).flatten().tolist() for layer in range(1, 9)}
    assert seen[3] == seen[2] == seen[1] == [BUILDING, FREE]
    assert (seen[4], seen[5]) == ([FREE, CAR], [CAR, THIN])
    assert seen[6] == seen[7] == seen[8] == [THIN, FREE]


def test_its_weight_is_chosen_on_frames_at_their_own_heights():
    prior = by_height(([CAR, FREE], 5), *[([FREE, FREE], 5)] * 9)
    labels = torch.tensor([FREE, CAR], dtype=torch.uint8).view(TALL.shape)
    chosen = prior.fit([(labels, torch.ones(3), 4)], lambda: OccupancyScores(TALL))
    assert prior.free_weight == CANDIDATES[4], "the largest of those that score the same"
    assert chosen[prior.free_weight] == 1.0


@pytest.mark.parametrize(
    "semantics",
    [
        torch.zeros(4, 1, 2, dtype=torch.uint8),
        torch.zeros(4, 1, 1),
        frames_of([BUILDING, 9, FREE, FREE])[0],
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_labels_that_do_not_fit_are_refused_and_not_counted(semantics):
    prior = VoxelPrior(GRID.shape)
    with pytest.raises(UserError, match=r"^semantics:"):
        prior.count(semantics)
    assert not prior.counts.any()
