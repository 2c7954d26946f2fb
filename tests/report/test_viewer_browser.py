"""The viewer in a real browser: it draws what the labels say, where they say it, and is steered."""

import numpy as np
import pytest

from src.ontology import CAR, CLASSES, FREE, GROUND, VRU
from src.report.scene import ERROR_PALETTE
from src.report.voxels import PALETTE
from tests.report.sample_page import box_of, choose, click, middle_of, plain_scene, view
from tests.report.street import pixels_of
from tests.report.test_voxel_mesh import count_faces

pytestmark = pytest.mark.slow

SHOWS = "what the predictions show"
FACES = "[...document.querySelectorAll('.view')].map(view => Number(view.dataset.faces))"
# Where the views look from as they are drawn, which plotly's public layout reports too late.
EYES = """[...document.querySelectorAll('.view')].filter(view => view.clientWidth).map(
    view => Object.values(view._fullLayout.scene._scene.getCamera().eye)
        .map(part => part.toFixed(3)).join(" "))"""
MISSED = ERROR_PALETTE["missed"]


def kind(class_id):
    return f"[data-kind='{CLASSES[class_id].replace('vru', 'VRU')}']"


def faces_of(volumes, classes):
    return [sum(count_faces(labels == class_id) for class_id in classes) for labels in volumes]


def one_eye(page):
    """Where all views look from, once they are still."""
    page.evaluate("new Promise((done) => setTimeout(done, 300))")
    page.wait(f"new Set({EYES}).size === 1")
    return page.evaluate(EYES)[0]


def test_it_draws_the_faces_that_a_brute_force_search_finds(page):
    scene = plain_scene()
    known = list(scene.known().values())
    assert page.evaluate(FACES) == faces_of(known, range(FREE))
    click(page, kind(GROUND))
    assert page.evaluate(FACES) == faces_of(known, [n for n in range(FREE) if n != GROUND])
    click(page, kind(GROUND))
    choose(page, SHOWS, "everywhere")
    volumes = list(scene.volumes.values())
    expected = [faces_of(known[:1], range(FREE))[0], *faces_of(volumes[1:], range(FREE))]
    assert page.evaluate(FACES) == expected


@pytest.mark.parametrize("key", ["1", "2"])
def test_the_uavs_left_is_left(page, key):
    click(page, f"[data-key='{key}']")
    image = view(page, 0)
    half = image.shape[1] / 2
    car, vru = (pixels_of(image, PALETTE[class_id])[:, 1] for class_id in (CAR, VRU))
    assert len(car) > 50
    assert len(vru) > 50
    assert np.median(car) < half < np.median(vru)


def test_views_show_what_differs_and_hide_what_nobody_knows(page):
    truth, baseline, skyocc = (view(page, n) for n in range(3))
    assert len(pixels_of(truth, PALETTE[VRU])) > 50
    assert len(pixels_of(baseline, PALETTE[VRU])) < 20, "predicted where none is labelled"
    assert len(pixels_of(skyocc, PALETTE[CAR])) > 50
    choose(page, SHOWS, "everywhere")
    assert len(pixels_of(view(page, 1), PALETTE[VRU])) > 50
    assert (view(page, 0) == truth).all(), "of the ground truth there is no more to show"


def test_errors_are_counted_and_colored(page):
    counts = (
        "[...document.querySelectorAll('.counts')].filter(span => span.offsetParent)"
        ".map(span => span.textContent)"
    )
    assert page.evaluate(counts) == []
    choose(page, SHOWS, "errors")
    expected = [view["counts"] for view in plain_scene().encoded()["views"]]
    assert page.evaluate(counts) == expected
    assert len(pixels_of(view(page, 1), MISSED)) > 50
    assert len(pixels_of(view(page, 0), MISSED)) < 20, "the ground truth keeps its classes"
    click(page, "[data-kind=missed]")
    assert len(pixels_of(view(page, 1), MISSED)) < 20


def test_the_number_of_views_follows_the_scene(page):
    views = "[...document.querySelectorAll('.view')].filter(view => view.clientWidth).length"
    assert page.evaluate(views) == 3
    for scene, count in (("1", 2), ("0", 3)):
        choose(page, "scene", scene)
        page.wait(f"document.querySelector('.viewer').dataset.scene === '{scene}'")
        assert page.evaluate(views) == count
        assert len(pixels_of(view(page, count - 1), PALETTE[CAR])) > 50


def test_mouse_and_keys_turn_all_views_together_and_1_goes_back(page):
    home, before = one_eye(page), [view(page, n) for n in range(3)]
    x, y = middle_of(page, 1)
    page.drag((x, y), (x + 80, y + 30))
    turned = [view(page, n) for n in range(3)]
    assert one_eye(page) != home
    assert all((a != b).any() for a, b in zip(before, turned))
    # The ground truth and the first prediction have the same car.
    cars = [pixels_of(image, PALETTE[CAR]).mean(axis=0) for image in turned[:2]]
    assert np.allclose(*cars, atol=1.5)
    page.press("1")
    page.mouse("mouseMoved", 1, 1)
    assert all((view(page, n) == before[n]).all() for n in range(3))
    for key in ("ArrowLeft", "ArrowUp", "+", "2"):
        last = one_eye(page)
        page.press(key)
        assert one_eye(page) != last, key


def test_the_pointer_names_the_voxel_in_every_view_and_marks_it_in_the_image(page):
    image, box = view(page, 0), box_of(page, 0)
    row, column = pixels_of(image, PALETTE[CAR]).mean(axis=0) + 2
    for nudge in (0, 1):
        page.mouse("mouseMoved", box["x"] + column + nudge, box["y"] + row)
    page.wait("document.querySelector('.probe').textContent.includes('Ground truth')")
    place, *classes = page.evaluate("document.querySelector('.probe').textContent").split(" · ")
    assert classes == ["Ground truth: car", "baseline: car", "skyocc: free"]
    ahead, left, up = (float(part.split()[1]) for part in place.split(", "))
    assert 20 < ahead < 25
    assert 8 < left < 12
    assert -10 < up < -8
    dot = "document.querySelector('.photo i')"
    assert page.evaluate(f"!{dot}.hidden")
    assert page.evaluate(f"parseFloat({dot}.style.left)") < 50, "left in the image as well"


def test_play_shows_every_scene_to_the_last_and_then_from_the_first(page):
    scenes = page.evaluate("document.querySelectorAll('.still').length")
    assert scenes > 1
    watch = "new MutationObserver(() => seen.push(box.dataset.scene))"
    page.evaluate("window.seen = []; window.box = document.querySelector('.viewer'); 0")
    page.evaluate(f"{watch}.observe(box, {{attributeFilter: ['data-scene']}})")
    for _ in range(2):
        click(page, ".play")
        page.wait("document.querySelector('.play').ariaPressed === 'false'")
        assert page.evaluate("box.dataset.scene") == str(scenes - 1)
    shown = page.evaluate("seen.filter((one, n) => one !== seen[n - 1])")
    assert shown == [str(n) for n in range(1, scenes)] + [str(n) for n in range(scenes)]
