"""Output of a command: whole lines, and how far it is: a bar in a terminal, lines in a file."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich import progress
from rich.console import Console

T = TypeVar("T")

# A log file in which nothing was printed for so long gets a line about the work under way.
LINE_S = 15.0
# So early the time that is left cannot be told.
EARLY_S = 3.0


_last_line_s = time.perf_counter()


def say(line: object) -> None:
    """Prints a line as it is: neither colored nor cut."""
    global _last_line_s
    _last_line_s = time.perf_counter()
    Console().print(str(line), highlight=False, soft_wrap=True, markup=False)


def duration(seconds: float) -> str:
    """Returns a time in the unit that suits it: ``40 s``, ``2.5 min``, ``12 min``, ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.{1 if seconds < 600 else 0}f} min"
    return f"{seconds / 3600:.1f} h"


class Meter:
    """How much of some work is done. ``doing`` says what is done and may change meanwhile."""

    def __init__(self, doing: str, total: float | None) -> None:
        self.doing, self.total, self.done = doing, total, 0.0
        self._start_s = time.perf_counter()

    def advance(self, steps: float = 1.0) -> None:
        """Adds steps to what is done."""
        self.done += steps

    @property
    def spent_s(self) -> float:
        return time.perf_counter() - self._start_s

    @property
    def left_s(self) -> float | None:
        """The time until all is done, at the mean speed so far; ``None`` where it is unknown."""
        if not self.total or not self.done or self.spent_s < EARLY_S:
            return None
        return self.spent_s * max(0.0, self.total / self.done - 1)

    @property
    def state(self) -> str:
        """The share that is done and the times, in words: ``40 % after 12 s, 18 s left``."""
        share = f"{100 * self.done / self.total:.0f} % " if self.total else ""
        left = "" if self.left_s is None else f", {duration(self.left_s)} left"
        return f"{share}after {duration(self.spent_s)}{left}"

    def __str__(self) -> str:
        return f"{self.doing}: {self.state}"


@contextmanager
def metered(doing: str, total: float | None = None) -> Iterator[Meter]:
    """Yields a meter and shows it until the work ends.

    A terminal shows a bar, which is gone in the end. A file gets a line whenever it had none for
    `LINE_S` seconds, also in a row of short works.
    """
    meter = Meter(doing, total)
    with (_bar if sys.stdout.isatty() else _lines)(meter):
        yield meter


def tracked(items: Iterable[T], doing: str, total: int | None = None) -> Iterator[T]:
    """Yields the items, and shows how many are done, as `metered` does."""
    if total is None and hasattr(items, "__len__"):
        total = len(items)
    with metered(doing, total) as meter:
        for item in items:
            yield item
            meter.advance()


@contextmanager
def _bar(meter: Meter) -> Iterator[None]:
    columns = "{task.description}", progress.BarColumn(bar_width=20), "{task.fields[state]}"
    with progress.Progress(*columns, transient=True) as bars:
        task = bars.add_task(meter.doing, total=meter.total, state="")

        def show() -> None:
            bars.update(task, description=meter.doing, completed=meter.done, state=meter.state)

        with _repeated(show, every_s=0.2):
            yield


@contextmanager
def _lines(meter: Meter) -> Iterator[None]:
    def tell() -> None:
        if time.perf_counter() - _last_line_s >= LINE_S:
            say(meter)

    with _repeated(tell, every_s=min(1.0, LINE_S)):
        yield


@contextmanager
def _repeated(call: Callable[[], None], every_s: float) -> Iterator[None]:
    """Calls a function again and again, from a thread of its own, until the work here ends."""
    ended = threading.Event()

    def repeat() -> None:
        call()
        while not ended.wait(every_s):
            call()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
