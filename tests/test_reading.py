"""docs/reading.md: every file and name that it points at is there."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROWS = [
    line.split("|")[1:-1]
    for line in (ROOT / "docs" / "reading.md").read_text().splitlines()
    if line.startswith("|") and "`tests/" in line
]


def names_of(path: Path) -> set[str]:
    """Functions and classes at the top of a module."""
    return {getattr(node, "name", "") for node in ast.parse(path.read_text()).body}


def test_the_table_covers_the_equations():
    ideas = " ".join(row[0] + row[1] for row in ROWS)
    numbers = {
        int(n) for text in re.findall(r"Eq\. ([\d and]+)", ideas) for n in re.findall(r"\d+", text)
    }

    assert numbers == set(range(1, 11))


def test_every_file_is_there():
    for path in {p for row in ROWS for p in re.findall(r"`([\w./]+\.(?:py|yaml))`", "".join(row))}:
        assert (ROOT / path).is_file(), path


def test_every_name_is_in_its_file():
    """Of the code and of the tests."""
    pairs = [pair for row in ROWS for pair in re.findall(r"`([\w./]+\.py)` `(\w+)`", "".join(row))]

    assert len(pairs) > 40
    for path, name in pairs:
        assert name in names_of(ROOT / path), (path, name)
