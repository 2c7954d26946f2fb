"""A page with something of everything, and how a test reads what a browser shows of it."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from src.ontology import BUILDING, CAR, FREE, GROUND, UNKNOWN, VRU
from src.report.curve_plot import Curve, CurvePlot
from src.report.page import write_page
from src.report.picture import Picture
from src.report.scene import Scene
from src.results.render import Cell, Table, table_of
from tests.report.street import GRID, HEIGHT, WIDTH, fill, street, tilted_frustum

READY = "document.documentElement.dataset.ready === 'true'"
FLOOR = (GROUND, (0, -25, -11), (50, 25, -10))
LEFT_CAR = (CAR, (20, 8, -10), (25, 12, -8))
RIGHT_VRU = (VRU, (20, -12, -10), (25, -8, -7))
WALL = (BUILDING, (30, -10, -10), (32, 10, 2))
SECRET = (VRU, (40, 20, -5), (44, 24, -1))
"""Predicted where the truth is unknown."""
NAN = float("nan")


def labels_of(*boxes):
    labels = np.full(GRID.shape, FREE, dtype=np.uint8)
    for class_id, lower_m, upper_m in boxes:
        fill(labels, GRID, class_id, lower_m, upper_m)
    return labels


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
    return Scene("plain", GRID, image, truth, predictions, frustum)


def street_scene():
    frustum = tilted_frustum(0.0, 0.0)
    image = np.full((HEIGHT, WIDTH, 3), 180, dtype=np.uint8)
    return Scene("street", GRID, image, street(GRID, frustum), {"skyocc": street(GRID)}, frustum)


def tables():
    rows = (
        ("b-run", (Cell(9.5, 9.0, 10.0), Cell(30.0))),
        ("a-run", (Cell(10.5, 10.0, 11.0), None)),
        ("c-run", (Cell(NAN), Cell(4.0))),
        ("d-run", (Cell(-1.0), Cell(100.0))),
        ("gain", (Cell(99.0, signed=True), None)),
    )
    ladder = table_of(rows, ["score", "error"])
    wide = [f"a rather long name {n}" for n in range(20)]
    filled = ("run", tuple(Cell(float(n), n - 1.0, n + 1.0) for n in range(20)))
    return [
        Table("ladder", "Ladder", "In percent.", ladder, {"score": "high", "error": "low"}),
        Table("wide", "Wide", "In percent.", table_of([filled], wide)),
    ]


def sheet():
    buffer = io.BytesIO()
    Image.fromarray(np.full((1200, 2400, 3), 200, np.uint8)).save(buffer, "png")
    return Picture(buffer.getvalue(), "a sheet")


def write_sample(path):
    """The page, with small stills: they take seconds in their own size."""
    curves = (Curve("a", (1, 2, 3), (3.0, 2.0, 1.5)), Curve("b", (1, 2), (4.0, 3.0)))
    facts = [("data set", "small-" + "f" * 60)]
    alarms = {"Missing": ["runs/" + "x" * 80]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("src.report.scene.STILL_PIX", (80, 60))
        write_page(
            path,
            "A report with a heading",
            facts,
            tables(),
            [CurvePlot("Loss", "", curves), CurvePlot("KAR-mIoU", "%", curves)],
            [sheet()],
            [plain_scene(), street_scene()],
            alarms,
        )


def click(page, selector):
    page.evaluate(f"document.querySelector(`{selector}`).click()")


def settle(page):
    """Until what was changed is drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def view(page, n):
    """RGBA of a view: the truth is the first."""
    settle(page)
    address = page.evaluate(f"document.querySelectorAll('canvas')[{n}].toDataURL('image/png')")
    encoded = base64.b64decode(address.split(",", 1)[1])
    return np.asarray(Image.open(io.BytesIO(encoded)).convert("RGBA"))


def pixels_of(image, color):
    """Row and column of the pixels of a colour's hue, which light and haze change little."""
    rgb = image[image[..., 3] == 255][:, :3].astype(np.float32)
    places = np.argwhere(image[..., 3] == 255)
    hue, wanted = (c - c.min(axis=-1, keepdims=True) for c in (rgb, np.asarray(color, np.float32)))
    strength = np.linalg.norm(hue, axis=-1)
    alike = hue @ wanted > 0.985 * strength * np.linalg.norm(wanted)
    return places[alike & (strength > 60)]


def canvas_in_sight(page, n):
    """Where a view is in the window, after scrolling to it: left, top, width and height."""
    canvas = f"document.querySelectorAll('canvas')[{n}]"
    page.evaluate(f"{canvas}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    settle(page)
    box = page.evaluate(f"({canvas}.getBoundingClientRect().toJSON())")
    return box["x"], box["y"], box["width"], box["height"]


def middle_of(page, n):
    x, y, width, height = canvas_in_sight(page, n)
    return x + width / 2, y + height / 2
