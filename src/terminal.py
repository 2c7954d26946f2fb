"""What a command says: whole lines, and progress bars where somebody watches."""

import sys
from collections.abc import Iterable
from typing import TypeVar

from rich.console import Console
from rich.progress import track

T = TypeVar("T")


def say(line: object) -> None:
    """Prints a line as it is: neither coloured nor cut."""
    Console().print(str(line), highlight=False, soft_wrap=True, markup=False)


def tracked(items: Iterable[T], doing: str, total: int | None = None) -> Iterable[T]:
    """The items, with a bar that is gone when they are done; none in a file."""
    return track(items, doing, total, transient=True, disable=not sys.stdout.isatty())
