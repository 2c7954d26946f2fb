"""The protocol that goes with a score, and what is refused by it."""

import dataclasses

import pytest

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics.protocol import SUPERVISED, VISIBLE, Protocol, require_same_protocol

METRIC = {"num_classes": 9, "free_index": 8, "horizon_s": 5.0}
SUITE = {"tube_s": 2.0, "rays": [100, 56], "sensitivity": {"horizon_s": [2.5, 5.0]}}


OF_NO_SUITE = '{"dataset": "a", "part": "test", "frames": 1, "grid": {}, "suite": []}'


@pytest.fixture
def protocol():
    hydra = {"_target_": "src.metrics.OccupancyScores", **METRIC}
    return Protocol.of("paper-1234", "test", 3800, VoxelGrid(), SUPERVISED, hydra, SUITE)


def test_it_reads_back_as_it_was_written_without_hydras_keys(protocol):
    again = Protocol.from_json(protocol.to_json())
    assert again.to_json() == protocol.to_json()
    assert again.voxel_grid == VoxelGrid()
    assert "_target_" not in protocol.to_json()
    require_same_protocol({"a": protocol, "b": again})


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"dataset": "paper-5678"}, "dataset"),
        ({"part": "val"}, "part"),
        ({"frames": 3799}, "frames"),
        ({"mask": VISIBLE}, "mask"),
        ({"metric": METRIC | {"horizon_s": 4.0}}, "metric.horizon_s"),
        ({"suite": SUITE | {"sensitivity": {"horizon_s": [5.0]}}}, "suite.sensitivity.horizon_s"),
        ({"rules": {}}, "rules.absent_class"),
    ],
)
def test_two_that_differ_are_refused_by_the_key(protocol, change, key):
    other = dataclasses.replace(protocol, **change)
    with pytest.raises(UserError, match=f"{key.replace('.', '[.]')}=") as error:
        require_same_protocol({"baseline": protocol, "skyocc": other})
    assert str(error.value).startswith("skyocc: ")
    assert "baseline" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"dataset": 1}', OF_NO_SUITE])
def test_another_text_is_one_clear_error(text):
    with pytest.raises(UserError, match=r"^protocol: cannot be read"):
        Protocol.from_json(text)


def test_a_metric_that_has_left_the_suite_is_left_out(protocol):
    entry = {"_target_": "src.metrics.KARSensitivity", "values": {"horizon_s": [2.5, 5.0]}}
    older = dataclasses.replace(protocol, suite=SUITE | {"metrics": {"sensitivity": entry}})
    read = Protocol.from_json(older.to_json()).suite
    assert read == {key: value for key, value in SUITE.items() if key != "sensitivity"} | {
        "metrics": {}
    }

    own = entry | {"_target_": "mine.Sensitivity"}
    mine = dataclasses.replace(protocol, suite=SUITE | {"metrics": {"sensitivity": own}})
    assert Protocol.from_json(mine.to_json()) == mine
