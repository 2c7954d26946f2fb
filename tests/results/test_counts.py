"""The counts of a run on disk: read back as they were, or refused in one line."""

import errno
import os

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.models.checkpoint import Checkpoint
from src.results.counts import Counts
from src.results.files import run_table
from tests.results.scored import counts, predicted


@pytest.fixture(scope="module", name="mine")
def _mine():
    return counts("mine", lambda target, n: predicted(target, 0.5, n))


@pytest.mark.parametrize("compressed", [True, False])
def test_counts_read_back_and_score_the_same(mine, tmp_path, compressed):
    mine.write(tmp_path / "tallies/mine.npz", compressed)
    again = Counts.read(tmp_path / "tallies/mine.npz")
    assert (again.name, again.clips, again.frames) == (mine.name, mine.clips, mine.frames)
    assert again.protocol.difference(mine.protocol) is None
    for metric, tables in mine.tables.items():
        for name, table in tables.items():
            assert torch.equal(again.tables[metric][name], table)
    first, second = (run_table({0: [each]}, {"test": lambda clip: True}) for each in (mine, again))
    assert first.equals(second)
    scored = first.set_index("score")
    for name, value in mine.scores("occupancy").items():
        assert scored.loc[name, "value"] == pytest.approx(float(value), nan_ok=True)


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive at all", "other", None])
def test_a_missing_or_broken_file_and_one_of_something_else_are_refused(tmp_path, content):
    path = tmp_path / "mine.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "other":
        np.savez(path, a=np.zeros(3))
    said = "no such file" if content is None else "cannot be read"
    with pytest.raises(UserError, match=rf"mine\.npz: {said}") as told:
        Counts.read(path)
    assert "delete" not in str(told.value), "it may be a sound file of something else"


@pytest.mark.parametrize("code", [errno.EACCES, errno.EIO])
def test_a_file_that_the_system_does_not_let_be_read_is_not_called_damaged(
    mine, tmp_path, monkeypatch, code
):
    """Neither counts nor a checkpoint."""
    mine.write(tmp_path / "mine.npz")
    (tmp_path / "mine.ckpt").touch()

    def refuse(*_, **__):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("numpy.load", refuse)
    monkeypatch.setattr("torch.load", refuse)
    for read, name in ((Counts.read, "mine.npz"), (Checkpoint.read, "mine.ckpt")):
        with pytest.raises(UserError, match=name) as told:
            read(tmp_path / name)
        assert "delete" not in str(told.value)


def test_a_damaged_file_is_named_in_one_line_whatever_is_broken(mine, tmp_path):
    path = tmp_path / "mine.npz"
    mine.write(path)
    whole = path.read_bytes()
    rng, lines = np.random.default_rng(0), []
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            Counts.read(path)
        except UserError as error:
            lines.append(str(error))
    assert len(lines) > 40
    assert all(line.startswith(f"{path}: cannot be read") for line in lines)
    assert not any("\n" in line for line in lines)
