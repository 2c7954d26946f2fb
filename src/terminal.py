"""Output of a command: whole lines, and progress bars where somebody watches."""

import sys
from collections.abc import Iterable
from typing import TypeVar

from rich.console import Console
from rich.progress import track

T = TypeVar("T")


def say(line: object) -> None:
    """Prints a line as it is: neither colored nor cut."""
    Console().print(str(line), highlight=False, soft_wrap=True, markup=False)


def tracked(items: Iterable[T], doing: str, total: int | None = None) -> Iterable[T]:
    """Yields the items beside a bar that is gone when they are done; a file shows no bar."""
    return track(items, doing, total, transient=True, disable=not sys.stdout.isatty())
