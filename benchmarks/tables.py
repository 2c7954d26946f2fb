"""The table that every benchmark prints: names to the left, numbers to the right."""

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints rows of texts under their columns."""
    table = Table(title=title)
    for number, column in enumerate(columns):
        table.add_column(column, justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    Console(width=110).print(table)


def print_line(line: str) -> None:
    """Prints a line as it is, however wide the terminal."""
    Console().print(line, highlight=False, soft_wrap=True, markup=False)
