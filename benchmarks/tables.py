"""The tables that benchmarks print: names to the left, numbers to the right, notes below."""

import statistics
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.settings import device_name
from benchmarks.timing import Measures, extra_mib, milliseconds
from src.terminal import say


def print_table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], notes: Iterable[str] = ()
) -> None:
    """Prints rows of texts under their columns, and below them a line for each note."""
    table = Table(title=escape(title))
    for number, column in enumerate(columns):
        table.add_column(column, justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)

    Console(width=110).print(table)
    for note in notes:
        say(note)


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
