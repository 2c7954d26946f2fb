"""Pages that are filled in: the templates in ``web/``."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

WEB = Path(__file__).with_name("web")

# In HTML whatever comes from data is escaped, so that no name of a run can become markup.
ENVIRONMENT = Environment(
    loader=FileSystemLoader(WEB),
    autoescape=select_autoescape(("html",)),
    undefined=StrictUndefined,
    trim_blocks=True,
)


def filled(template: str, **values: object) -> str:
    """Returns a template with its names filled in; a name without a value raises an error."""
    return ENVIRONMENT.get_template(template).render(**values)
