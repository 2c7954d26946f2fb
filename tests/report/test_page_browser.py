"""The page in a real browser: it runs, fits, sorts, and shows pictures where there is no WebGL2."""

import pytest

from tests.report.browser import opened
from tests.report.sample_page import READY, click, settle, view

pytestmark = pytest.mark.slow


def column_of(page, number, name="ladder"):
    """A table's cells of one column, as printed."""
    cells = f"[...document.querySelectorAll('#table-{name} tbody tr')].map(r => r.cells[{number}]"
    return page.evaluate(f"{cells}.textContent)")


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
