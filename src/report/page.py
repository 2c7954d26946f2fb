"""The report's page: one HTML file with tables, curves, pictures and scenes to fly around in.

Everything is in the file: it opens from a disk without a network, and its content security policy
forbids it to ask for anything. Templates, styles and scripts lie in `web/`.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from types import MappingProxyType

from ..atomic import replacing
from ..errors import UserError
from ..ontology import CLASSES, COLORS, OCCUPIED, UNKNOWN
from ..results.render import Table, table_html
from .curve_plot import CurvePlot, plot_html
from .picture import Picture
from .scene import Scene
from .statistics_figure import readable

WEB = Path(__file__).parent / "web"
STYLES = ("page.css", "tables.css", "plots.css", "viewer.css")
SCRIPTS = (
    *("report.js", "tables.js", "plots.js", "pictures.js"),
    *("volume.js", "faces.js", "figures.js", "shaders.js", "renderer.js"),
    *("orbit.js", "lens.js", "steering.js", "probe.js", "legend.js", "stage.js"),
    *("views.js", "controls.js", "viewer.js", "start.js"),
)
"""In the order in which they need each other."""

SETTINGS, TABLES = "Settings", "Tables"
"""Titles of sections, for remarks."""

LONG = 80
"""Letters of a fact that is no longer a mere value."""


def write_page(
    path: str | Path,
    heading: str,
    facts: Sequence[tuple[str, str]],
    tables: Sequence[Table] = (),
    curves: Sequence[CurvePlot] = (),
    sheets: Sequence[Picture] = (),
    scenes: Sequence[Scene] = (),
    alarms: Mapping[str, Sequence[str]] = MappingProxyType({}),
    settings: Sequence[Table] = (),
    remarks: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> None:
    """Write the page, whole or not at all.

    ``facts`` are names and values that say where the numbers come from. ``alarms`` are lists, by
    their headings, of what a reader must know first, as what is missing; ``settings`` are tables of
    how the runs differ, and ``remarks`` lines that stand before a section, by its title. What is
    empty is left out. Raises `UserError` where a picture is neither PNG nor JPEG, and for a path
    that cannot be written.
    """
    keys = [table.key for table in (*tables, *settings)]
    if len(set(keys)) < len(keys):
        raise UserError(f"{path}: two of its tables have the same key; name them apart")
    sections = {
        SETTINGS: "".join(map(table_html, settings)),
        TABLES: "".join(map(table_html, tables)),
        "Learning curves": _grid("plots", map(plot_html, curves)),
        "Scenes": _viewer_html(scenes),
        "Pictures": "".join(map(_sheet_html, sheets)),
    }
    before = {title: "".join(map(_remark_html, remarks.get(title, ()))) for title in sections}
    shown = {title: before[title] + content for title, content in sections.items()}
    shown = {title: content for title, content in shown.items() if content}
    page = _filled(
        "page.html",
        title=escape(heading),
        heading=escape(heading),
        facts=_facts_html(facts),
        alarms="".join(_alarm_html(*alarm) for alarm in alarms.items()),
        contents="".join(f'<a href="#{_anchor(t)}">{t}</a>' for t in shown),
        sections="".join(
            f'<section id="{_anchor(t)}" class="part"><h2>{t}</h2>{content}</section>'
            for t, content in shown.items()
        ),
        styles="\n".join(map(_text, STYLES)),
        scripts="\n".join(map(_text, SCRIPTS)),
    )
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def _text(name: str) -> str:
    return (WEB / name).read_text(encoding="utf-8")


def _filled(name: str, **values: str) -> str:
    """A template with each ``{{name}}`` replaced once; what a value holds is left as it is."""
    first, *rest = _text(name).split("{{")
    parts = (part.partition("}}") for part in rest)
    return first + "".join(values[key] + after for key, _, after in parts)


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


def _grid(kind: str, parts: Iterable[str]) -> str:
    content = "".join(parts)
    return content and f'<div class="{kind}">{content}</div>'


def _facts_html(facts: Sequence[tuple[str, str]]) -> str:
    """Short values side by side; a sentence takes a row."""
    kinds = ("value", "sentence")
    rows = (
        f'<div class="{kinds[len(v) > LONG]}"><dt>{escape(n)}</dt><dd>{escape(v)}</dd></div>'
        for n, v in facts
    )
    content = "".join(rows)
    return content and f'<dl class="facts">{content}</dl>'


def _alarm_html(heading: str, lines: Sequence[str]) -> str:
    listed = "".join(f"<li>{escape(line)}</li>" for line in lines)
    if not listed:
        return ""
    name = escape(heading)
    return f'<aside class="alarm" aria-label="{name}"><h2>{name}</h2><ul>{listed}</ul></aside>'


def _remark_html(line: str) -> str:
    return f'<p class="remark">{escape(line)}</p>'


def _sheet_html(sheet: Picture) -> str:
    """A picture as wide as the page; pressed, it shows its own size and scrolls in its box."""
    width, height = sheet.size_pix
    caption = escape(sheet.caption)
    return (
        '<figure class="sheet"><div class="scroll"><button type="button" aria-pressed="false" '
        f'title="in its own size, or as wide as the page"><img src="{sheet.address}" '
        f'alt="{caption}" width="{width}" height="{height}"></button></div>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _viewer_html(scenes: Sequence[Scene]) -> str:
    """The viewer with the scenes' data, and a still picture of every view for where it cannot run
    and for print."""
    if not scenes:
        return ""
    names = [readable(CLASSES[n]) for n in OCCUPIED]
    colors = [COLORS[CLASSES[n]] for n in OCCUPIED]
    return _filled(
        "viewer.html",
        classes=_json({"names": names, "colors": colors, "unknown": UNKNOWN}),
        legend="".join(
            f'<li style="--color: rgb{color}"><i></i>{name}</li>'
            for name, color in zip(names, colors)
        ),
        scenes="".join(
            f'<script type="application/json" class="scene">{_json(scene.encoded())}</script>'
            for scene in scenes
        ),
        stills="".join(map(_stills_html, scenes)),
    )


def _stills_html(scene: Scene) -> str:
    figures = "".join(
        f'<figure><img src="{picture.address}" alt="{escape(picture.caption)}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
        for picture in (scene.photo, *scene.stills())
    )
    title = escape(scene.title)
    return f'<section class="still"><h3>{title}</h3><div>{figures}</div></section>'


def _json(data: object) -> str:
    """JSON that no text in it can end the element of."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
