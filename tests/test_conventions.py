"""Executes the pages under `docs/`: their rules are asserts, and a broken one names its line."""

import re
import traceback
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "conventions.md"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_blocks(page: str, name: str) -> None:
    """Runs the python blocks of a page in one namespace, in their order.

    Raises `AssertionError` that begins with ``<name>:<line>``, the line being that of the page.
    """
    namespace: dict[str, object] = {}
    for block in BLOCK.finditer(page):
        lines_before = page.count("\n", 0, block.start(1))
        try:
            exec(compile("\n" * lines_before + block[1], name, "exec"), namespace)
        except SyntaxError as error:
            raise AssertionError(f"{name}:{error.lineno}: {error}") from error
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            line = [frame.lineno for frame in frames if frame.filename == name][-1]
            source = page.splitlines()[line - 1].strip()
            raise AssertionError(f"{name}:{line}: {source}: {error!r}") from error


@pytest.mark.parametrize("name", ["conventions.md", "metrics.md"])
def test_every_rule_of_the_page_holds(name: str) -> None:
    run_blocks((DOCS / name).read_text(encoding="utf-8"), f"docs/{name}")


def test_every_section_carries_an_assert() -> None:
    _, *sections = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert len(sections) >= 10
    for section in sections:
        code = "".join(BLOCK.findall(section))
        assert "assert " in code, section.splitlines()[0]


def test_a_broken_rule_is_named_by_its_line() -> None:
    page = (
        "# Page\n\n```python\nx = 1\n```\n\ntext\n\n```python\nassert x == 1\nassert x == 2\n```\n"
    )
    with pytest.raises(AssertionError, match=r"^page\.md:11: assert x == 2"):
        run_blocks(page, "page.md")


def test_a_block_that_is_no_python_is_named_by_its_line() -> None:
    with pytest.raises(AssertionError, match=r"^page\.md:3: "):
        run_blocks("text\n```python\nx = = 1\n```\n", "page.md")
