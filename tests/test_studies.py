"""The studies stand beside the project: it works without any of them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_nothing_in_src_imports_a_study():
    imports = re.compile(r"^\s*(?:from|import) (?:studies|tests)\b", re.MULTILINE)
    importing = [path for path in (ROOT / "src").rglob("*.py") if imports.search(path.read_text())]
    assert importing == []
