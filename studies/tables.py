"""Tables that studies print: names to the left, numbers to the right, notes below."""

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from src.terminal import say


def print_table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], notes: Iterable[str] = ()
) -> None:
    """Prints rows of texts under their columns, and below them a line for each note."""
    table = Table(title=escape(title))
    for number, column in enumerate(columns):
        table.add_column(column, justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))

    Console(width=110).print(table)
    for note in notes:
        say(note)
