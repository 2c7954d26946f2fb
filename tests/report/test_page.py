"""The page as a file: whole, by itself, and safe against whatever a run is called."""

import io
import re

import numpy as np
import pytest
from PIL import Image

from src.errors import UserError
from src.report.curve_plot import Curve, CurvePlot
from src.report.page import SCRIPTS, STYLES, WEB, write_page
from src.report.picture import Picture
from src.results.render import Cell, Table, table_of
from tests.report.test_page_scene import SMALL, scene_of

TABLE = Table("ladder", "Ladder", "In percent.", table_of([("x", [Cell(1.0)])], ["a"]))
PLOT = CurvePlot("Loss", "", (Curve("a", (1, 2), (2.0, 1.0)),))
SETTINGS = Table("set", "Set", "Those.", table_of([("key", ["value"])], ["b"]))
WICKED = "</script><script>alert('x')</script><img src=x onerror=alert(1)>{{scripts}}"


def picture(kind="png"):
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((2, 3, 3), np.uint8)).save(buffer, kind)
    return Picture(buffer.getvalue(), "a sheet")


def written(folder, **content):
    path = folder / "report" / "index.html"
    write_page(path, **{"heading": "Report", "facts": [("scale", "small")], **content})
    return path.read_text(encoding="utf-8")


@pytest.fixture(autouse=True, scope="module")
def _small_stills():
    """They take seconds in their own size, and `test_scene.py` looks at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("src.report.scene.STILL_PIX", (40, 30))
        yield


@pytest.fixture(name="whole", scope="module")
def _whole(tmp_path_factory):
    return written(
        tmp_path_factory.mktemp("page"),
        tables=[TABLE],
        curves=[PLOT],
        sheets=[picture(), picture("jpeg")],
        scenes=[scene_of(SMALL)],
        alarms={"Missing": ["runs/small/attitude/seed1: not finished"]},
        settings=[SETTINGS],
    )


def test_the_page_needs_nothing_but_itself(whole):
    addresses = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', whole)
    assert len(addresses) > 6
    assert all(re.match(r"data:image/(png|jpeg);base64,|data:,$|#", each) for each in addresses)
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", whole)
    assert "default-src 'none'" in whole, "what is forgotten here, the browser refuses"


def test_every_style_and_script_is_in_it(whole):
    assert {path.name for path in WEB.glob("*.css")} == set(STYLES)
    assert {path.name for path in WEB.glob("*.js")} == set(SCRIPTS)
    for name in (*STYLES, *SCRIPTS):
        assert (WEB / name).read_text() in whole
    assert "{{" not in whole


def test_all_parts_are_named_in_the_contents(whole):
    anchors = re.findall(r'<a href="#([^"]*)"', whole)
    assert anchors == ["settings", "tables", "learning-curves", "scenes", "pictures"]
    for anchor in anchors:
        assert f'id="{anchor}"' in whole
    assert "runs/small/attitude/seed1: not finished" in whole


def test_what_must_be_known_first_stands_under_its_own_heading(tmp_path):
    alarms = {"Not a clean comparison": ["other code"], "Missing": ["seed1"], "Nothing": []}
    page = written(tmp_path, alarms=alarms, tables=[TABLE], remarks={"Tables": ["In percent."]})
    found = re.findall(r'<aside class="alarm"[^>]*><h2>(.*?)</h2><ul><li>(.*?)</li></ul>', page)
    assert found == [("Not a clean comparison", "other code"), ("Missing", "seed1")]
    assert page.index("seed1") < page.index("<main>") < page.index("In percent.</p><section")


def test_what_is_empty_is_left_out(tmp_path):
    page = written(tmp_path, tables=[TABLE])
    assert re.findall(r'<a href="#([^"]*)"', page) == ["tables"]
    assert '<aside class="alarm"' not in page
    assert '<p class="remark"' not in page
    assert 'class="viewer"' not in page


def test_no_name_becomes_markup(tmp_path):
    table = Table("t", WICKED, WICKED, table_of([(WICKED, [WICKED])], [WICKED]))
    plot = CurvePlot(WICKED, WICKED, (Curve(WICKED, (1,), (1.0,)),))
    scene = scene_of(SMALL)
    scene = scene_of(SMALL, title=WICKED, predictions={WICKED: scene.truth})
    sheet = Picture(picture().encoded, WICKED)
    harmless = written(tmp_path, scenes=[scene_of(SMALL)], tables=[TABLE], curves=[PLOT])
    page = written(
        tmp_path,
        heading=WICKED,
        facts=[(WICKED, WICKED)],
        tables=[table],
        curves=[plot],
        sheets=[sheet],
        scenes=[scene],
        alarms={WICKED: [WICKED]},
        remarks={"Tables": [WICKED]},
    )
    assert page.count("<script") == harmless.count("<script")
    assert page.count("</script") == harmless.count("</script")
    assert "<img src=x" not in page
    assert page.count('"use strict"') == 1


def test_the_same_content_gives_the_same_bytes(tmp_path):
    content = {"tables": [TABLE], "curves": [PLOT], "scenes": [scene_of(SMALL)]}
    assert written(tmp_path / "a", **content) == written(tmp_path / "b", **content)


def test_a_page_that_cannot_be_finished_leaves_the_old_one(tmp_path):
    before = written(tmp_path, heading="before")
    for broken in (b"no picture", b"\x89PNG\r\n\x1a\n cut"):
        with pytest.raises(UserError, match="neither a PNG nor a JPEG"):
            written(tmp_path, sheets=[Picture(broken, "sheet")])
    with pytest.raises(UserError, match="same key"):
        written(tmp_path, tables=[TABLE, TABLE])
    folder = tmp_path / "report"
    assert [path.name for path in folder.iterdir()] == ["index.html"]
    assert (folder / "index.html").read_text() == before


def test_no_room_to_write_is_one_line(tmp_path):
    (tmp_path / "report").write_text("")
    with pytest.raises(UserError, match="cannot be written") as caught:
        written(tmp_path)
    assert "\n" not in str(caught.value)
