"""The viewer in a real browser: it draws what the labels say, where they say it, and is steered."""

import numpy as np
import pytest
import torch

from src.geometry import project
from src.ontology import CAR, FREE, GROUND, UNKNOWN, VRU
from src.report.voxels import PALETTE
from tests.report.sample_page import (
    canvas_in_sight,
    click,
    middle_of,
    pixels_of,
    plain_scene,
    settle,
    view,
)
from tests.report.street import GRID, HEIGHT, WIDTH

pytestmark = pytest.mark.slow

SHIFT = 8
"""Of DevTools, as a modifier."""


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


def test_shift_leaves_one_class_alone_and_brings_the_others_back(page):
    """With the mouse or from the keyboard, which has no second press."""
    pressed = (
        "[...document.querySelector('.legend.classes').children]"
        ".map(c => c.getAttribute('aria-pressed'))"
    )
    before = page.evaluate(pressed)
    page.evaluate(f"document.querySelector('.legend.classes').children[{CAR}].focus()")
    page.press("Enter", shift=True)
    assert page.evaluate(pressed) == ["false"] * CAR + ["true"] + ["false"] * (
        len(before) - CAR - 1
    )
    page.press("Enter", shift=True)
    assert page.evaluate(pressed) == ["true"] * len(before) == before


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
