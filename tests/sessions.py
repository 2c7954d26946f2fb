"""What the processes of a session do, for tests that start some and end them."""

import os
from collections.abc import Iterator
from pathlib import Path

TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def running_in(session: int) -> list[str]:
    """Command lines of the processes of a session that have not ended."""
    return [(path / "cmdline").read_text() for path, fields in _stats(session) if fields[0] != "Z"]


def spent_s(session: int) -> float:
    """Processor seconds of a session: of those that run, and of those that these waited for.

    They say how far a program is, however much else the machine does.
    """
    return sum(sum(map(int, fields[11:15])) for _, fields in _stats(session)) / TICKS_A_SECOND


def _stats(session: int) -> Iterator[tuple[Path, list[str]]]:
    """The folder of each process and the fields of its ``stat`` from the state on."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            fields = (path / "stat").read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == session:
                yield path, fields
        except (FileNotFoundError, ProcessLookupError):
            continue
