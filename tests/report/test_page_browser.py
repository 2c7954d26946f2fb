"""The page in a real browser: it runs, sorts, draws what the labels say, where they say it."""

import base64
import io

import numpy as np
import pytest
import torch
from PIL import Image

from src.geometry import VoxelGrid, project
from src.ontology import BUILDING, CAR, FREE, GROUND, UNKNOWN, VRU
from src.report.curve_plot import Curve, CurvePlot
from src.report.page import write_page
from src.report.picture import Picture
from src.report.report_table import Cell, Column, ReportTable
from src.report.scene import Scene
from src.report.voxels import PALETTE
from tests.report.browser import opened
from tests.report.street import HEIGHT, WIDTH, fill, street, tilted_frustum

pytestmark = pytest.mark.slow

GRID = VoxelGrid(shape=(50, 50, 30))
READY = "document.documentElement.dataset.ready === 'true'"
FLOOR = (GROUND, (0, -25, -11), (50, 25, -10))
LEFT_CAR = (CAR, (20, 8, -10), (25, 12, -8))
RIGHT_VRU = (VRU, (20, -12, -10), (25, -8, -7))
WALL = (BUILDING, (30, -10, -10), (32, 10, 2))
SECRET = (VRU, (40, 20, -5), (44, 24, -1))
"""Predicted where the truth is unknown."""
NAN = float("nan")
SHIFT = 8
"""Of DevTools, as a modifier."""


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
    columns = (Column("a", "score", best="high"), Column("b", "error", best="low"))
    rows = (
        ("b-run", (Cell(9.5, 9.0, 10.0), Cell(30.0))),
        ("a-run", (Cell(10.5, 10.0, 11.0), None)),
        ("c-run", (Cell(NAN), Cell(4.0))),
        ("d-run", (Cell(-1.0), Cell(100.0))),
        ("gain", (Cell(99.0, signed=True), None)),
    )
    wide = tuple(Column(f"c{n}", f"a rather long name {n}") for n in range(20))
    filled = ("run", tuple(Cell(float(n), n - 1.0, n + 1.0) for n in range(20)))
    return [
        ReportTable("ladder", "Ladder", "In percent.", columns, rows),
        ReportTable("wide", "Wide", "In percent.", wide, (filled,)),
    ]


def sheet():
    buffer = io.BytesIO()
    Image.fromarray(np.full((1200, 2400, 3), 200, np.uint8)).save(buffer, "png")
    return Picture(buffer.getvalue(), "a sheet")


@pytest.fixture(name="path", scope="module")
def _path(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    curves = (Curve("a", (1, 2, 3), (3.0, 2.0, 1.5)), Curve("b", (1, 2), (4.0, 3.0)))
    facts = [("data set", "small-" + "f" * 60)]
    missing = ["runs/" + "x" * 80]
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
            missing,
        )
    return path


@pytest.fixture(name="browser", scope="module")
def _browser():
    with opened() as page:
        yield page


@pytest.fixture(name="page")
def _page(browser, path):
    """The page, just loaded, in a large window; afterwards it must not have thrown anything."""
    browser.show(1000, 800)
    browser.open(path)
    browser.wait(READY)
    yield browser
    assert browser.errors == []
    assert browser.evaluate("document.documentElement.dataset.error") is None


def click(page, selector, times=1):
    page.evaluate(f"for (let n = 0; n < {times}; n++) document.querySelector(`{selector}`).click()")


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


def column_of(page, number, name="ladder"):
    """A table's cells of one column, as printed."""
    cells = f"[...document.querySelectorAll('#table-{name} tbody tr')].map(r => r.cells[{number}]"
    return page.evaluate(f"{cells}.textContent)")


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


# ------------------------------------------------------------------------------------- the page


def test_it_says_that_it_holds_what_was_written(page):
    told = page.evaluate("({...document.documentElement.dataset})")
    counts = {"tables": "2", "curves": "4", "pictures": "1", "scenes": "2"}
    assert told == {**counts, "viewer": "3d", "ready": "true"}


def test_it_asks_for_nothing_outside_itself(page, path):
    asked = {url for url in page.requests if not url.startswith(("data:", "blob:"))}
    assert asked <= {path.resolve().as_uri(), "about:blank"}


@pytest.mark.parametrize(("width", "phone"), [(1400, False), (768, False), (390, True)])
def test_nothing_is_wider_than_the_window(page, width, phone):
    page.show(width, 844, phone=phone)
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = "document.querySelector('#table-wide .scroll')"
    assert page.evaluate(f"{box}.scrollWidth > {box}.clientWidth"), "it scrolls in its own box"


def test_light_and_dark_follow_the_reader(page):
    color = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(color)
    before = view(page, 0)
    page.show(1000, 800, dark=True)
    assert light == "rgb(255, 255, 255)"
    assert sum(map(int, page.evaluate(color)[4:-1].split(","))) < 150
    page.wait(f"{READY} && matchMedia('(prefers-color-scheme: dark)').matches")
    assert (view(page, 0) != before).any(), "the lines in the views too"


def test_paper_gets_the_stills(page):
    shown = (
        "[...document.querySelectorAll('.viewer, .stills')].map(e => getComputedStyle(e).display)"
    )
    assert page.evaluate(shown) == ["block", "none"]
    page.send("Emulation.setEmulatedMedia", media="print")
    assert page.evaluate(shown) == ["none", "block"]


def test_a_sheet_grows_when_it_is_pressed(page):
    width = "document.querySelector('.sheet img').clientWidth"
    assert page.evaluate(width) < 1000
    click(page, ".sheet button")
    assert page.evaluate(width) == 2400
    click(page, ".sheet button")
    assert page.evaluate(width) < 1000


def test_a_curve_names_the_values_under_the_pointer(page):
    read = "document.querySelector('.plot .stop').textContent"
    values = "[...document.querySelectorAll('.plot:first-child .runs b')].map(b => b.textContent)"
    assert page.evaluate(read) == "epoch 3"
    assert page.evaluate(values) == ["1.50", "–"]
    page.evaluate("document.querySelector('.plot svg').focus()")
    page.press("ArrowLeft")
    assert page.evaluate(read) == "epoch 2"
    assert page.evaluate(values) == ["2.00", "3.00"]
    page.press("Escape")
    assert page.evaluate(read) == "epoch 3"


# ----------------------------------------------------------------------------------- the tables


def test_a_click_sorts_by_value_and_a_third_one_restores_the_order(page):
    before = column_of(page, 0)
    assert before == ["b-run", "a-run", "c-run", "d-run", "gain"]
    sort = "document.querySelectorAll('#table-ladder thead th')[1]"
    orders, names = [], []
    for _ in range(3):
        click(page, "#table-ladder thead th:nth-child(2) button")
        orders.append(column_of(page, 0))
        names.append(page.evaluate(f"{sort}.getAttribute('aria-sort')"))
    assert orders[0] == ["a-run", "b-run", "d-run", "gain", "c-run"], "the empty one last"
    assert orders[1] == ["d-run", "b-run", "a-run", "gain", "c-run"], "still last"
    assert orders[2] == before
    assert names == ["descending", "ascending", "none"]


def test_numbers_are_sorted_as_numbers_and_one_column_at_a_time(page):
    click(page, "#table-ladder thead th:nth-child(2) button")
    click(page, "#table-ladder thead th:nth-child(3) button")
    assert column_of(page, 0) == ["c-run", "b-run", "d-run", "a-run", "gain"], "4, 30, 100"
    heads = "[...document.querySelectorAll('#table-ladder thead th')].map(h => h.ariaSort)"
    assert page.evaluate(heads) == ["none", "none", "ascending"]


def test_the_keyboard_sorts_too(page):
    page.evaluate("document.querySelector('#table-ladder thead button').focus()")
    page.press("Enter")
    assert column_of(page, 0) == ["a-run", "b-run", "c-run", "d-run", "gain"]


# ----------------------------------------------------------------------------------- the viewer


def faces_of(labels, shown):
    """How many faces of shown voxels border on none, counted one by one."""
    drawn = np.isin(labels, list(shown))
    padded = np.pad(drawn, 1)
    count = 0
    for x, y, z in np.argwhere(drawn) + 1:
        for dx, dy, dz in np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)]):
            count += not padded[x + dx, y + dy, z + dz]
    return count


def test_it_draws_the_faces_that_a_brute_force_search_finds(page):
    scene = plain_scene()
    known = [np.where(scene.truth == UNKNOWN, UNKNOWN, labels) for _, labels in scene.volumes()]
    faces = "[...document.querySelectorAll('canvas')].map(c => Number(c.dataset.faces))"
    assert page.evaluate(faces) == [faces_of(labels, range(FREE)) for labels in known]
    click(page, f".legend.classes button:nth-child({GROUND + 1})")
    rest = [n for n in range(FREE) if n != GROUND]
    assert page.evaluate(faces) == [faces_of(labels, rest) for labels in known], "what was behind"
    click(page, f".legend.classes button:nth-child({GROUND + 1})")
    click(page, ".beyond input")
    volumes = [labels for _, labels in scene.volumes()]
    assert page.evaluate(faces) == [faces_of(labels, range(FREE)) for labels in volumes]


@pytest.mark.parametrize("preset", ["behind", "above"])
def test_the_uavs_left_is_left(page, preset):
    click(page, f"[data-view={preset}]")
    image = view(page, 0)
    half = image.shape[1] / 2
    car, vru = (pixels_of(image, PALETTE[class_id])[:, 1] for class_id in (CAR, VRU))
    assert len(car) > 50
    assert len(vru) > 50
    assert car.max() < half < vru.min()


def test_through_the_camera_it_shows_what_projects_there(page):
    """The voxels of the car, through the projection chain, roll and pitch included."""
    scene = plain_scene()
    click(page, "[data-view=camera]")
    image = view(page, 0)
    height, width = image.shape[:2]
    centers = GRID.centers(torch.float64)[torch.from_numpy(scene.truth == CAR)]
    frustum = scene.frustum
    pix, _ = project(centers, frustum.camera_from_occ, frustum.pix_from_camera)
    scale = 0.96 * min(width / WIDTH, height / HEIGHT)
    expected = (pix - torch.tensor([WIDTH, HEIGHT]) / 2) * scale + torch.tensor([width, height]) / 2
    shown = pixels_of(image, PALETTE[CAR])[:, ::-1] + 0.5
    room = 2.0 / 20 * WIDTH / 2 * scale  # a voxel and a bit at 20 m
    low, high = expected.amin(dim=0).numpy(), expected.amax(dim=0).numpy()
    assert np.allclose(shown.min(axis=0), low, atol=room)
    assert np.allclose(shown.max(axis=0), high, atol=room)


def test_hiding_a_class_removes_its_pixels_and_no_others(page):
    car = f".legend.classes button:nth-child({CAR + 1})"
    before = view(page, 0)
    assert len(pixels_of(before, PALETTE[CAR])) > 50
    click(page, car)
    hidden = view(page, 0)
    assert len(pixels_of(hidden, PALETTE[CAR])) == 0
    assert len(pixels_of(hidden, PALETTE[VRU])) == len(pixels_of(before, PALETTE[VRU]))
    click(page, car)
    assert (view(page, 0) == before).all()


def test_views_show_what_differs_and_hide_what_nobody_knows(page):
    truth, baseline, skyocc = (view(page, n) for n in range(3))
    assert len(pixels_of(truth, PALETTE[VRU])) > 50
    assert len(pixels_of(baseline, PALETTE[VRU])) == 0, (
        "the predicted one is where none is labelled"
    )
    assert len(pixels_of(skyocc, PALETTE[CAR])) > 50
    click(page, ".beyond input")
    assert len(pixels_of(view(page, 1), PALETTE[VRU])) > 50
    assert (view(page, 0) == truth).all(), "of the truth there is no more to show"


def test_errors_are_counted_and_coloured(page):
    scene = plain_scene()
    click(page, "[data-mode=errors]")
    captions = page.evaluate(
        "[...document.querySelectorAll('.views figcaption span')].map(s => s.textContent)"
    )
    known, truth = scene.truth != UNKNOWN, scene.truth
    expected = [""]
    for prediction in scene.predictions.values():
        right = (truth == prediction) & (truth < FREE)
        other = (truth != prediction) & (truth < FREE) & (prediction < FREE)
        alarm, missed = (truth == FREE) & (prediction < FREE), (truth < FREE) & (prediction == FREE)
        counts = [int((each & known).sum()) for each in (right, other, alarm, missed)]
        names = ("right", "other class", "false alarm", "missed")
        expected.append(" · ".join(f"{name} {n:,}" for name, n in zip(names, counts)))
    assert captions == expected
    baseline = view(page, 1)
    missed = pixels_of(baseline, (226, 38, 120))
    assert len(missed) > 50
    assert len(pixels_of(view(page, 0), (226, 38, 120))) == 0, "the truth keeps its classes"
    click(page, ".legend.errors button:nth-child(4)")
    assert len(pixels_of(view(page, 1), (226, 38, 120))) == 0


def test_the_picker_goes_round_and_the_number_of_views_follows(page):
    scene = "document.querySelector('.viewer').dataset.scene"
    chosen = "document.querySelector('select').value"
    seen = f"[{scene}, {chosen}, document.querySelectorAll('canvas').length]"
    assert page.evaluate(seen) == ["0", "0", 3]
    for button, n, views in (("next", 1, 2), ("next", 0, 3), ("previous", 1, 2)):
        click(page, f".{button}")
        page.wait(f"{scene} === '{n}'")
        assert page.evaluate(seen) == [str(n), str(n), views]
    assert (view(page, 0)[..., 3] > 0).mean() > 0.2


def test_mouse_and_keys_steer_all_views_and_0_goes_back(page):
    before = [view(page, n) for n in range(3)]
    x, y = middle_of(page, 1)
    page.drag((x, y), (x + 80, y + 30))
    turned = [view(page, n) for n in range(3)]
    assert all((a != b).any() for a, b in zip(before, turned))
    page.press("0")
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=1)
    assert all((view(page, n) == before[n]).all() for n in range(3))
    for key in ("ArrowLeft", "+", "2", "e"):
        last = view(page, 1)
        page.press(key)
        assert (view(page, 1) != last).any(), key


def test_a_drag_turns_what_is_near_with_the_mouse_and_with_shift_moves_all(page):
    x, y = middle_of(page, 2)
    before = pixels_of(view(page, 2), PALETTE[CAR]).mean(axis=0)
    page.drag((x, y), (x + 40, y))
    turned = pixels_of(view(page, 2), PALETTE[CAR]).mean(axis=0)
    assert turned[1] > before[1] + 5
    page.drag((x, y), (x + 40, y + 20), modifiers=SHIFT)
    moved = pixels_of(view(page, 2), PALETTE[CAR]).mean(axis=0)
    assert np.allclose(moved - turned, (20, 40), rtol=0.3)


def test_the_wheel_zooms_only_in_a_view_that_was_pressed(page):
    x, y = middle_of(page, 0)
    before, top = view(page, 0), page.evaluate("scrollY")
    wheel = {"type": "mouseWheel", "deltaX": 0, "deltaY": -60}
    page.send("Input.dispatchMouseEvent", x=x, y=y, **wheel)
    page.wait(f"scrollY < {top}")
    x, y = middle_of(page, 0)
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=y)
    assert (view(page, 0) == before).all()
    page.evaluate("document.querySelector('canvas').focus({preventScroll: true})")
    page.send("Input.dispatchMouseEvent", x=x, y=y, **wheel)
    page.wait("document.querySelector('[data-view=behind]').ariaPressed === 'false'")
    assert (view(page, 0) != before).any()


def test_two_fingers_zoom(page):
    page.show(390, 844, phone=True)
    x, y = middle_of(page, 0)
    page.evaluate("document.querySelector('canvas').focus({preventScroll: true})")
    before = len(pixels_of(view(page, 0), PALETTE[CAR]))
    for kind, spread in (("touchStart", 30), ("touchMove", 45), ("touchMove", 60)):
        fingers = [{"x": x - spread, "y": y, "id": 0}, {"x": x + spread, "y": y, "id": 1}]
        page.send("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
    page.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert len(pixels_of(view(page, 0), PALETTE[CAR])) > 1.5 * before


def test_the_pointer_names_the_voxel_in_every_view_and_marks_it_in_the_image(page):
    left, top, width, _ = canvas_in_sight(page, 0)
    image = view(page, 0)
    row, column = pixels_of(image, PALETTE[CAR]).mean(axis=0) * width / image.shape[1]
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=left + column, y=top + row)
    settle(page)
    words = page.evaluate("document.querySelector('.probe').textContent")
    assert " left, " in words
    assert " below · Ground truth: car · baseline: car · skyocc: free" in words
    dot = "document.querySelector('.photo i')"
    assert page.evaluate(f"!{dot}.hidden")
    assert page.evaluate(f"parseFloat({dot}.style.left)") < 50, "left in the image as well"


# ------------------------------------------------------------------------------- without WebGL2


def test_without_webgl2_it_says_so_and_shows_the_stills(path):
    with opened(webgl=False) as page:
        page.show(1000, 800)
        page.open(path)
        page.wait(READY)
        assert page.evaluate("document.documentElement.dataset.viewer") == "stills"
        message = page.evaluate("document.querySelector('.without').textContent")
        assert "has no WebGL2" in message
        stills = (
            "[...document.querySelectorAll('.still img')].map(i => i.getBoundingClientRect().width)"
        )
        assert len(page.evaluate(stills)) == 4 + 3
        assert min(page.evaluate(stills)) > 50
        assert page.evaluate("document.querySelector('.viewer').hidden")
        assert page.errors == []
