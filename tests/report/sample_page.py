"""A page with something of everything, and how a test reads what a browser shows of it."""

import base64
import io
import json
import zlib

import numpy as np
import pytest
from markupsafe import Markup
from PIL import Image

from src.ontology import BUILDING, CAR, FREE, UNKNOWN, VRU
from src.report.curve_plot import Curve, CurvePlot
from src.report.page import write_page
from src.report.picture import Picture
from src.report.scene import VoxelScene
from src.results.render import Cell, Table, table_html
from tests.report.street import (
    FLOOR,
    GRID,
    HEIGHT,
    WIDTH,
    fill,
    labels_of,
    street,
    tilted_frustum,
)

READY = "document.documentElement.dataset.ready === 'true'"
LEFT_CAR = (CAR, (20, 8, -10), (25, 12, -8))
RIGHT_VRU = (VRU, (20, -12, -10), (25, -8, -7))
WALL = (BUILDING, (30, -10, -10), (32, 10, 2))
SECRET = (VRU, (40, 20, -5), (44, 24, -1))
"""Predicted where the truth is unknown."""
NAN = float("nan")


def plain_scene():
    """A floor with a car on the left and a VRU on the right, and two predictions of it."""
    truth = labels_of(FLOOR, LEFT_CAR, RIGHT_VRU, WALL)
    fill(truth, GRID, UNKNOWN, (35, 15, -20), (50, 25, 10))
    predictions = {
        "baseline": labels_of(FLOOR, LEFT_CAR, SECRET),
        "skyocc": labels_of(FLOOR, RIGHT_VRU, WALL, (CAR, (10, -2, -10), (14, 2, -8))),
    }
    frustum = tilted_frustum(0.2, 0.15)
    image = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    return VoxelScene("plain", GRID, image, truth, predictions, frustum)


def street_scene():
    frustum = tilted_frustum(0.0, 0.0)
    image = np.full((HEIGHT, WIDTH, 3), 180, dtype=np.uint8)
    return VoxelScene(
        "street", GRID, image, street(GRID, frustum), {"skyocc": street(GRID)}, frustum
    )


def tables():
    rows = (
        ("b-run", (Cell(9.5, 9.0, 10.0), Cell(30.0))),
        ("a-run", (Cell(10.5, 10.0, 11.0), None)),
        ("c-run", (Cell(NAN), Cell(4.0))),
        ("d-run", (Cell(-1.0), Cell(100.0))),
        ("gain", (Cell(99.0, signed=True), None)),
    )
    best = {"score": "high", "error": "low"}
    wide = [f"a rather long name {n}" for n in range(20)]
    filled = ("run", tuple(Cell(float(n), n - 1.0, n + 1.0) for n in range(20)))
    made = [
        Table("ladder", "Ladder", "In percent.", list(best), rows, best=best),
        Table("wide", "Wide", "In percent.", wide, [filled]),
    ]
    return [Markup(table_html(table)) for table in made]


def sheet(kind="png"):
    buffer = io.BytesIO()
    Image.fromarray(np.full((1200, 2400, 3), 200, np.uint8)).save(buffer, kind)
    return Picture(buffer.getvalue(), f"a sheet as {kind}")


def write_sample(path):
    """Writes the page, with small stills: they take seconds in their own size."""
    curves = (
        Curve("a", (1, 2, 3), (3.0, 2.0, 1.5)),
        Curve("a", (1, 2), (5.0, 3.0)),
        Curve("b", (1, 2), (4.0, 3.0)),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("src.report.scene.STILL_PIX", (80, 60))
        write_page(
            path,
            "A report with a heading",
            [("dataset", "small-" + "f" * 60)],
            tables=tables(),
            curves=[CurvePlot("Loss", "", curves), CurvePlot("KAR-mIoU", "%", curves)],
            sheets=[sheet()],
            scenes=[plain_scene(), street_scene()],
            alarms={"Missing": ["runs/" + "x" * 80]},
        )


def read_scene(text):
    """The JSON of a `VoxelScene`, as the page holds it."""
    return json.loads(zlib.decompress(base64.b64decode(text)))


def labels_in(view, shape):
    """The labels of a view of that JSON."""
    labels = np.frombuffer(view["labels"].encode(), np.uint8) - ord("0")
    return np.where(labels > FREE, UNKNOWN, labels).astype(np.uint8).reshape(shape)


def click(page, selector):
    page.evaluate(f"document.querySelector(`{selector}`).click()")


def choose(page, label, value):
    """Chooses an option of a list."""
    page.evaluate(
        f"(() => {{ const list = document.querySelector(`[aria-label='{label}']`);"
        f"list.value = '{value}'; list.dispatchEvent(new Event('change')); }})()"
    )


def box_of(page, n):
    """Where a view is in the window, after scrolling to it."""
    view = f"document.querySelectorAll('.view')[{n}]"
    page.evaluate(f"{view}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    return page.evaluate(f"{view}.getBoundingClientRect().toJSON()")


def middle_of(page, n):
    box = box_of(page, n)
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def view(page, n):
    """RGB of a view, once it is drawn: the ground truth is the first."""
    box = box_of(page, n)
    last, shot = None, page.screenshot()
    while shot != last:
        page.evaluate("new Promise((done) => setTimeout(done, 50))")
        last, shot = shot, page.screenshot()
    corners = (box["left"] + 2, box["top"] + 2, box["right"] - 2, box["bottom"] - 2)
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB").crop([*map(round, corners)]))
