"""Which frames a condition counts, and what becomes of the counts."""

import math

import pytest
import torch
from src.tasks.condition import ConditionCount, conditions_of

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import OccupancyScores
from src.metrics.protocol import SUPERVISED, Protocol

GRID = VoxelGrid(shape=(5, 5, 3), lower_m=(0, -5, -3), upper_m=(10, 5, 3))
CLIPS = ["a/0", "b/0"]


def batch_of(roll_deg, pitch_deg, clips):
    generator = torch.Generator().manual_seed(0)
    attitude_deg = torch.tensor([roll_deg, pitch_deg]).T.float()
    shape = (len(clips), *GRID.shape)
    return {
        "attitude_rad": torch.deg2rad(attitude_deg),
        "clip": clips,
        "semantics": torch.randint(9, shape, generator=generator).byte(),
        "velocity_mps": torch.full((len(clips), 3), 2.0),
    }


def test_bins_of_tilt_share_all_frames_among_them():
    conditions = list(conditions_of([5, 10], [], [], False))
    assert [each.name for each in conditions] == [
        "true", "tilt_0_5deg", "tilt_5_10deg", "tilt_10_infdeg"
    ]  # fmt: skip
    batch = batch_of([0, -3, 4, -9], [0, 3, -5, 8], ["a/0"] * 4)
    held = torch.stack([each.holds(batch) for each in conditions])
    assert held[0].all()
    assert held[1:].int().tolist() == [[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 1]]


def test_faults_follow_and_have_names_for_files():
    names = [each.name for each in conditions_of([], [1.0, 3.0], [0.1], False)]
    assert names == ["true", "noise_1deg", "noise_3deg", "delay_0.1s"]


def test_told_a_level_attitude_there_are_all_frames_and_each_bin_again():
    conditions = list(conditions_of([5], [], [0.1], True))
    assert [each.name for each in conditions] == [
        *("true", "tilt_0_5deg", "tilt_5_infdeg", "delay_0.1s"),
        *("level", "level_tilt_0_5deg", "level_tilt_5_infdeg"),
    ]
    assert len({each.fault for each in conditions}) == 3
    batch = batch_of([0, -6], [0, 0], ["a/0"] * 2)
    assert conditions[-1].holds(batch).tolist() == [False, True], "by the true tilt"


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (([10, 5], [], []), "tilt_edges_deg"),
        (([0], [], []), "tilt_edges_deg"),
        (([math.nan], [], []), "tilt_edges_deg"),
        (([], [0.0], []), "noise_deg"),
        (([], [], [-0.1]), "delay_s"),
        (([], [], [math.inf]), "delay_s"),
        (([], [3.0, 3.0], []), "noise_deg"),
        (([], [], [0.1, 0.10000001]), "delay_s"),
        (([5.0, 5.0000001], [], []), "tilt_edges_deg"),
    ],
)
def test_values_that_make_no_sense_are_refused(words, key):
    with pytest.raises(UserError, match=rf"task\.{key}: .*; give "):
        list(conditions_of(*words, level=False))


def test_the_bins_tallies_add_up_to_that_of_all_frames():
    conditions = list(conditions_of([5, 10], [], [], False))
    counts = [ConditionCount(each, OccupancyScores(GRID), CLIPS) for each in conditions]
    batch = batch_of([0, 6, 4, 20], [0, 0, 4, 0], ["a/0", "a/0", "b/0", "b/0"])
    labels = batch["semantics"].roll(1, dims=1)
    for count in counts:
        count.add(batch, labels)
    protocol = Protocol.of("data", "test", 4, GRID, SUPERVISED, {}, {})
    whole, *bins = (count.tally(protocol) for count in counts)
    assert whole.frames == [2, 2]
    assert [tally.frames for tally in bins] == [[1, 0], [1, 1], [0, 1]]
    assert bins[1].protocol.part == "test, tilt_5_10deg"
    assert bins[1].protocol.frames == 2
    for name, table in whole.tables["occupancy"].items():
        assert sum(tally.tables["occupancy"][name] for tally in bins).equal(table)
