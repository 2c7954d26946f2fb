"""The page in a real browser: it runs, fits, sorts, and shows pictures where there is no WebGL."""

import pytest

from tests.report.browser import opened
from tests.report.sample_page import READY, click

pytestmark = pytest.mark.slow

SHOWN = "[...document.querySelectorAll('.viewer, .stills')].map(e => getComputedStyle(e).display)"


def column_of(page, number):
    """A table's cells of one column, as printed."""
    cells = f"[...document.querySelectorAll('#table-ladder tbody tr')].map(r => r.cells[{number}]"
    return page.evaluate(f"{cells}.textContent)")


# ------------------------------------------------------------------------------------- the page


def test_it_asks_for_nothing_outside_itself(page, path):
    asked = {url for url in page.requests if not url.startswith(("data:", "blob:"))}
    assert asked <= {path.resolve().as_uri(), "about:blank"}


@pytest.mark.parametrize(("width", "phone"), [(1400, False), (768, False), (390, True)])
def test_nothing_is_wider_than_the_window(page, width, phone):
    page.show(width, 844, phone=phone)
    page.wait(f"document.querySelector('.view canvas').clientWidth <= {width}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = "document.querySelector('#table-wide .scroll')"
    assert page.evaluate(f"{box}.scrollWidth > {box}.clientWidth"), "it scrolls in its own box"


def test_light_and_dark_follow_the_reader(page):
    background = "getComputedStyle(document.body).backgroundColor"
    letters = "getComputedStyle(document.querySelector('.curves text')).fill"
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    assert page.evaluate(letters) == "rgb(24, 28, 36)"
    page.show(1000, 800, dark=True)
    assert page.evaluate(background) == "rgb(18, 21, 27)"
    assert page.evaluate(letters) == "rgb(232, 235, 240)"


def test_paper_gets_the_stills(page):
    assert page.evaluate(SHOWN) == ["block", "none"]
    page.send("Emulation.setEmulatedMedia", media="print")
    assert page.evaluate(SHOWN) == ["none", "block"]


def test_without_webgl_it_shows_the_stills(path):
    with opened(webgl=False) as page:
        page.show(1000, 800)
        page.open(path)
        page.wait(READY)
        assert page.evaluate(SHOWN) == ["none", "block"]
        widths = "[...document.querySelectorAll('.still img')].map(i => i.clientWidth)"
        assert len(page.evaluate(widths)) == 4 + 3
        assert min(page.evaluate(widths)) > 50
        assert "WebGL" in page.evaluate("document.querySelector('.stills').textContent")
        assert page.errors == []


def test_curves_name_the_values_under_the_pointer_and_in_a_table(page):
    assert page.evaluate("document.querySelectorAll('.curves .lines path').length") == 2 * 5
    plot = "document.querySelector('.curves')"
    page.evaluate(f"{plot}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    box = page.evaluate(f"{plot}.getBoundingClientRect().toJSON()")
    page.mouse("mouseMoved", box["x"] + 0.6 * box["width"], box["y"] + box["height"] / 2)
    page.wait(f"{plot}.querySelector('.hoverlayer text') !== null")
    told = page.evaluate(f"{plot}.querySelector('.hoverlayer').textContent")
    assert "2.50 (2.00 to 3.00, seeds: 2)" in told
    page.evaluate("document.querySelector('.plot summary').focus()")
    page.press("Enter")
    cells = "[...document.querySelectorAll('.plot details[open] td')].map(c => c.innerText)"
    assert page.evaluate(cells)[-1] == "–"
    assert "2.50 (2.00 to 3.00, seeds: 2)" in page.evaluate(cells)


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
