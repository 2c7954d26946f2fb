"""Texts and pages that are filled in: the templates in ``markdown/`` and ``web/``."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from ..atomic import replacing

# In HTML whatever comes from data is escaped, so that no name of a run can become markup.
ENVIRONMENT = Environment(
    loader=FileSystemLoader([Path(__file__).parent / name for name in ("markdown", "web")]),
    autoescape=select_autoescape(("html",)),
    undefined=StrictUndefined,
    trim_blocks=True,
)


def filled(template: str, **values: object) -> str:
    """Returns a template with its names filled in; a name without a value raises an error."""
    return ENVIRONMENT.get_template(template).render(**values)


def write_text(path: Path, text: str) -> None:
    """Writes a text, whole or not at all. Raises `UserError` where it cannot be written."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def markdown(text: str) -> str:
    """Returns text that Markdown shows as it is written, also in a cell."""
    return "".join(f"\\{letter}" if letter in "\\|_*`<[" else letter for letter in text)


ENVIRONMENT.filters["markdown"] = markdown
