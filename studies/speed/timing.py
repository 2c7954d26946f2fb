"""The time of stages and of contenders that take turns, and the memory that one takes.

In turns, whatever else the machine does meets all of them; so ratios can be trusted, and
milliseconds less.
"""

import ctypes
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch

from studies.settings import device_name
from studies.tables import print_table

Measures = Mapping[str, Callable[[], object]]


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the wall-clock seconds of a block, or of a function that it decorates, to a stage."""
    # A GPU works on its own while the host goes on: both ends of the time must wait.
    wait_for_gpu()
    start_s = time.perf_counter()
    yield
    wait_for_gpu()
    seconds[stage] += time.perf_counter() - start_s


def milliseconds(measures: Measures, rounds: int) -> dict[str, list[float]]:
    """Returns the milliseconds of every run of each measure, after one that is not counted."""
    for measure in measures.values():
        measure()  # compiles, and takes memory

    spent_ms: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(rounds):
        seconds: dict[str, float] = defaultdict(float)
        for name, measure in measures.items():
            with timed(seconds, name):
                measure()
            spent_ms[name].append(1e3 * seconds[name])
    return spent_ms


def extra_mib(measure: Callable[[], object]) -> float:
    """Returns how far the memory in use rises above where it stood, while something runs.

    It is the memory of the GPU where there is one; otherwise the resident memory, on Linux with
    glibc.
    """
    if torch.cuda.is_available():
        torch.cuda.reset_peak_memory_stats()
        before = torch.cuda.memory_allocated()
        measure()
        wait_for_gpu()
        return (torch.cuda.max_memory_allocated() - before) / 2**20

    # Memory that was freed, but is kept for later, would hide the memory that is taken now.
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")
    before = _status_kib("VmRSS")
    measure()
    return max(0, _status_kib("VmHWM") - before) / 1024


def print_costs(subject: str, measures: Measures, rounds: int, notes: Iterable[str] = ()) -> None:
    """Runs measures by turns, and prints the time and the memory of each.

    ``times faster`` is the median of the first measure over that of each; ``MiB`` is what one run
    takes beyond what is there before.
    """
    spent_ms, rows, first_ms = milliseconds(measures, rounds), [], None
    for name, times_ms in spent_ms.items():
        median_ms = statistics.median(times_ms)
        first_ms = first_ms or median_ms
        times = f"{median_ms:.2f}", f"{min(times_ms):.2f}", f"{1e3 / median_ms:.1f}"
        more = f"{first_ms / median_ms:.2f}", f"{extra_mib(measures[name]):.1f}"
        rows.append((name, *times, *more))

    columns = ("", "median ms", "min ms", "a second", "times faster", "MiB")
    print_table(f"{subject}; {device_name()}", columns, rows, notes)


def wait_for_gpu() -> None:
    """Waits until the GPU has done all that it was given; without one, does nothing."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def _status_kib(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(key)).split()[1])
