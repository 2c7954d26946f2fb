"""A page in a browser, for the tests that look at one."""

import pytest

from tests.report.browser import opened
from tests.report.sample_page import READY, write_sample


@pytest.fixture(name="path", scope="module")
def _path(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    write_sample(path)
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
