"""The tally that keeps the counts of a suite on disk."""

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.metrics.protocol import SUPERVISED, Protocol
from src.metrics.suite import intervals_of
from src.metrics.tally import Tally
from tests.metrics.inputs import CLIPS, METRIC, SUITE


@pytest.fixture
def tally(scored, grid):
    protocol = Protocol.of("mini-0", "test", 8, grid, SUPERVISED, METRIC, SUITE)
    return Tally("mine", protocol, CLIPS, [4, 4, 0], scored.tables())


def test_a_tally_reads_back_and_scores_the_same(tally, scored, tmp_path):
    tally.write(tmp_path / "tallies" / "mine.npz")
    again = Tally.read(tmp_path / "tallies" / "mine.npz")
    assert (again.name, again.clips, again.frames) == (tally.name, tally.clips, tally.frames)
    assert again.protocol.difference(tally.protocol) is None
    for metric, tables in tally.tables.items():
        for name, table in tables.items():
            assert torch.equal(again.tables[metric][name], table)
    rows = again.rows()
    assert rows == [0, 1]
    intervals = intervals_of(again.suite(), again.tables, rows, 50, seed=0, level=0.9)
    for name, score in scored.scores().items():
        assert intervals[name].value == pytest.approx(score, abs=1e-6, nan_ok=True)
        if not np.isnan(score):
            assert intervals[name].low - 1e-9 <= intervals[name].value


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all"])
def test_a_broken_tally_is_one_clear_error(tmp_path, content):
    path = tmp_path / "mine.npz"
    path.write_bytes(content)
    with pytest.raises(UserError, match="cannot be read") as error:
        Tally.read(path)
    assert str(path) in str(error.value)


def test_a_missing_tally_says_what_to_do(tmp_path):
    with pytest.raises(UserError, match="no such file; give the command of its run again"):
        Tally.read(tmp_path / "mine.npz")


def test_an_archive_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(UserError, match="cannot be read"):
        Tally.read(tmp_path / "other.npz")


def test_a_damaged_tally_is_named_in_one_line_whatever_is_broken(tally, tmp_path):
    path = tmp_path / "mine.npz"
    tally.write(path)
    whole = path.read_bytes()
    rng, said = np.random.default_rng(0), []
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            Tally.read(path)
        except UserError as error:
            said.append(str(error))
    assert len(said) > 40
    assert all(line.startswith(f"{path}: cannot be read") for line in said)
    assert not any("\n" in line for line in said)
