"""Locks between processes, and between the file descriptors of one."""

from contextlib import ExitStack

import pytest

from src.errors import UserError
from src.locks import locked, locked_if_free
from tests.sessions import start

HOLDER = """
import sys, time
from pathlib import Path
from src.locks import locked
with locked(Path(sys.argv[1]), None, shared=sys.argv[2] == "shared"):
    print("held", flush=True)
    time.sleep(60)
"""


class Waiting(Exception):
    """Ends what would wait."""


def wait():
    raise Waiting


def is_free(path):
    with locked_if_free(path) as free:
        return free


@pytest.mark.parametrize("kind", ["shared", "alone"])
def test_another_process_keeps_out_whom_it_must_until_it_is_killed(tmp_path, kind):
    path = tmp_path / "lock"
    with start("-c", HOLDER, str(path), kind) as holder:
        assert holder.stdout.readline() == "held\n"
        assert not is_free(path)
        with ExitStack() as held:
            if kind == "alone":
                held.enter_context(pytest.raises(Waiting))
            held.enter_context(locked(path, wait, shared=True))
        holder.kill()
    assert is_free(path)


def test_who_shares_keeps_others_out_until_it_leaves(tmp_path):
    path = tmp_path / "lock"
    with locked(path, wait, shared=True), locked(path, wait, shared=True):
        assert not is_free(path)
    with locked_if_free(path) as free:
        assert free
        assert not is_free(path)


def test_a_file_system_without_locks_is_named(tmp_path, no_locks):
    with pytest.raises(UserError, match=r"lock: .*paths\.data"):
        is_free(tmp_path / "lock")
