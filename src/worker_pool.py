"""Worker processes that start afresh, and of which none outlives its work."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Final, TypeVar

import torch

from .heap import keep_freed_memory

T = TypeVar("T")

# Forked processes would share bullet's and numba's state with their parent.
SPAWN: Final = multiprocessing.get_context("spawn")


def default_workers() -> int:
    """Returns the number of cores that this process may use: a worker for each."""
    return len(os.sched_getaffinity(0))


@contextmanager
def worker_pool(
    workers: int, setup: Callable[..., None] | None = None, arguments: tuple = ()
) -> Iterator[ProcessPoolExecutor]:
    """Starts processes of one thread each, in which ``setup(*arguments)`` is called first.

    A failure or an interrupt ends them at once, and so does the end of their parent.
    """
    before = multiprocessing.active_children()
    start = setup, arguments

    with _spawning(), ProcessPoolExecutor(workers, SPAWN, _start_worker, start) as pool:
        try:
            yield pool
        except BaseException:
            for process in multiprocessing.active_children():
                if process not in before:
                    process.terminate()
            raise


def mapped(function: Callable[..., T], workers: int, *arguments: Iterable) -> Iterator[T]:
    """Yields results of a function in the order of its arguments, from worker processes.

    With one worker it is called in this process, which saves the start of another.
    """
    if workers == 1:
        yield from map(function, *arguments)
        return
    with worker_pool(workers) as pool:
        yield from pool.map(function, *arguments)


@contextmanager
def _spawning() -> Iterator[None]:
    """Makes spawning the default way of starting processes for a while.

    A worker takes over its parent's default, by name. A launcher such as joblib's has a way of its
    own, which a fresh process would not know.
    """
    before = multiprocessing.get_start_method(allow_none=True)
    multiprocessing.set_start_method("spawn", force=True)
    try:
        yield
    finally:
        multiprocessing.set_start_method(before, force=True)


def _start_worker(setup: Callable[..., None] | None, arguments: tuple) -> None:
    # Ctrl-C reaches every process of the terminal; the parent ends its workers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    keep_freed_memory()
    if setup is not None:
        setup(*arguments)


def _die_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)
