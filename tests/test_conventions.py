"""Executes the pages under `docs/`: their rules are asserts, and a broken one names its line."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", ["conventions.md", "metrics.md"])
def test_every_rule_of_the_page_holds(name: str) -> None:
    page = (DOCS / name).read_text(encoding="utf-8")
    namespace: dict[str, object] = {}
    for block in BLOCK.finditer(page):
        # Lines are counted as on the page, so that the traceback of a broken rule names its own.
        above = "\n" * page.count("\n", 0, block.start(1))
        exec(compile(above + block[1], str(DOCS / name), "exec"), namespace)


def test_every_section_carries_an_assert() -> None:
    page = (DOCS / "conventions.md").read_text(encoding="utf-8")
    _, *sections = re.split(r"^## ", page, flags=re.MULTILINE)
    assert len(sections) >= 10
    for section in sections:
        assert "assert " in "".join(BLOCK.findall(section)), section.splitlines()[0]
