"""Locks, between file descriptors of one process as between processes."""

from contextlib import ExitStack

import pytest

from src.errors import UserError
from src.locks import locked, locked_if_free


def never():
    pytest.fail("there was nothing to wait for")


def test_who_shares_keeps_others_out_until_it_leaves(tmp_path):
    path = tmp_path / "lock"
    with ExitStack() as held:
        for _ in range(2):
            held.enter_context(locked(path, never, shared=True))
        with locked_if_free(path) as free:
            assert not free
    with locked_if_free(path) as free:
        assert free
        with locked_if_free(path) as again:
            assert not again


def test_who_must_wait_says_so(tmp_path):
    class Waiting(Exception):
        pass

    def on_wait():
        raise Waiting

    with (
        locked(tmp_path / "lock", never),
        pytest.raises(Waiting),
        locked(tmp_path / "lock", on_wait, shared=True),
    ):
        pass


def test_a_file_system_without_locks_is_named(tmp_path, monkeypatch):
    def flock(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", flock)
    with (
        pytest.raises(UserError, match=r"lock: this file system has no file locks.*paths\.data"),
        locked_if_free(tmp_path / "lock"),
    ):
        pass
