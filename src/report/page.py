"""The report's page: one HTML file with tables, curves, pictures, and scenes that turn.

Everything is in the file, plotly's own script too: it opens from a disk without a network, and its
content security policy forbids it to ask for anything. The template, the style sheet and the
scripts lie in `web/`.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from markupsafe import Markup
from plotly.offline import get_plotlyjs

from ..atomic import replacing
from ..errors import UserError
from .curve_plot import CurvePlot
from .picture import Picture
from .scene import ERROR_PALETTE, VoxelScene
from .template import filled
from .voxel_mesh import CLASS_PALETTE

# Titles of the sections that can have remarks.
SETTINGS, TABLES = "Settings", "Tables"


def write_page(
    path: str | Path,
    heading: str,
    facts: Sequence[tuple[str, str]],
    tables: Sequence[Markup] = (),
    curves: Sequence[CurvePlot] = (),
    sheets: Sequence[Picture] = (),
    scenes: Sequence[VoxelScene] = (),
    alarms: Mapping[str, Sequence[str]] = MappingProxyType({}),
    settings: Sequence[Markup] = (),
    remarks: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> None:
    """Writes the page, whole or not at all.

    ``facts`` are names and values that say where the numbers come from. ``tables`` are HTML, and so
    are ``settings``, the tables of how the runs differ. ``alarms`` are lists, by their headings, of
    what a reader must know first. ``remarks`` are lines that stand before a section, by its title.
    An empty section is left out. All text but those tables is escaped.

    Raises `UserError` where a picture is neither PNG nor JPEG, where two parts of the tables have
    one id, and for a path that cannot be written.
    """
    ids = re.findall(r'\sid="([^"]*)"', "".join([*settings, *tables]))
    if len(set(ids)) < len(ids):
        raise UserError(f"{path}: two of its tables have the same key; name them apart")

    contents = {
        SETTINGS: settings,
        TABLES: tables,
        "Learning curves": curves,
        "Scenes": scenes,
        "Pictures": sheets,
    }
    sections = [(title, remarks.get(title, ()), parts) for title, parts in contents.items()]

    page = filled(
        "page.html",
        heading=heading,
        facts=facts,
        alarms={title: lines for title, lines in alarms.items() if lines},
        sections=[section for section in sections if any(section[1:])],
        anchor=lambda title: title.lower().replace(" ", "-"),
        class_palette=CLASS_PALETTE,
        error_palette=ERROR_PALETTE,
        plotly=Markup(get_plotlyjs()) if curves or scenes else "",
    )
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
