"""The page as a file: whole, by itself, and safe against whatever a run is called."""

import re

import pytest
from plotly.offline import get_plotlyjs

from src.errors import UserError
from src.report.curve_plot import Curve, CurvePlot
from src.report.page import write_page
from src.report.picture import Picture
from src.report.template import WEB
from tests.report.sample_page import sheet, tables
from tests.report.test_page_scene import SMALL, scene_of

TABLE, OTHER_TABLE = tables()
PLOT = CurvePlot("Loss", "", (Curve("a", (1, 2), (2.0, 1.0)),))
WICKED = "</script><script>alert('x')</script><img src=x onerror=alert(1)>{{ plotly }}"


def written(folder, **content):
    """The page without plotly's own script."""
    path = folder / "report" / "index.html"
    write_page(path, **{"heading": "Report", "facts": [("scale", "small")], **content})
    return path.read_text(encoding="utf-8").replace(get_plotlyjs(), "PLOTLY")


@pytest.fixture(autouse=True, scope="module")
def _small_stills():
    """They take seconds in their own size, and `test_page_scene.py` looks at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("src.report.scene.STILL_PIX", (40, 30))
        yield


@pytest.fixture(name="whole", scope="module")
def _whole(tmp_path_factory):
    return written(
        tmp_path_factory.mktemp("page"),
        tables=[TABLE],
        curves=[PLOT],
        sheets=[sheet(), sheet("jpeg")],
        scenes=[scene_of(SMALL)],
        alarms={"Missing": ["runs/small/attitude/seed1: not finished"]},
        settings=[OTHER_TABLE],
    )


def test_the_page_needs_nothing_but_itself(whole):
    addresses = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', whole)
    assert len(addresses) > 6
    assert all(re.match(r"data:image/(png|jpeg);base64,|data:,$|#", each) for each in addresses)
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", whole)
    assert "default-src 'none'" in whole, "what is forgotten here, the browser refuses"
    assert whole.count("PLOTLY") == 1


def test_the_style_and_the_scripts_are_in_it_and_stay_few(whole):
    for name in ("page.css", "page.js", "viewer.js"):
        assert (WEB / name).read_text().strip() in whole
    assert not re.search(r"\{[{%]", whole)
    assert sum(len(path.read_text().splitlines()) for path in WEB.iterdir()) <= 365


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
    assert page.index("seed1") < page.index("<main>") < page.index("In percent.</p>")


def test_what_is_empty_is_left_out(tmp_path):
    page = written(tmp_path, tables=[TABLE])
    assert re.findall(r'<a href="#([^"]*)"', page) == ["tables"]
    for kind in ("alarm", "remark", "viewer", "plots"):
        assert f'class="{kind}"' not in page
    assert "PLOTLY" not in page, "4.8 MB for nothing"
    plots = written(tmp_path, curves=[CurvePlot("Loss", "", (Curve("a", (), ()),))])
    assert 'class="plot"' in plots
    assert 'class="curves"' not in plots


def test_no_name_becomes_markup(tmp_path):
    scene = scene_of(SMALL)
    wicked_scene = scene_of(SMALL, title=WICKED, predictions={WICKED: scene.truth})
    plots = [CurvePlot(name, name, (Curve(name, (1,), (1.0,)),)) for name in ("a", WICKED)]
    harmless = written(tmp_path, scenes=[scene], tables=[TABLE], curves=plots[:1])
    page = written(
        tmp_path,
        heading=WICKED,
        facts=[(WICKED, WICKED)],
        tables=[WICKED],
        curves=plots[1:],
        sheets=[Picture(sheet().encoded, WICKED)],
        scenes=[wicked_scene],
        alarms={WICKED: [WICKED]},
        remarks={"Tables": [WICKED]},
    )
    assert page.count("<script") == harmless.count("<script")
    assert page.count("</script") == harmless.count("</script")
    assert "<img src=x" not in page
    assert page.count("&lt;/script&gt;") > 10


def test_the_same_content_gives_the_same_bytes(tmp_path):
    content = {"tables": [TABLE], "curves": [PLOT], "scenes": [scene_of(SMALL)]}
    assert written(tmp_path / "a", **content) == written(tmp_path / "b", **content)


def test_a_page_that_cannot_be_finished_leaves_the_old_one(tmp_path):
    before = written(tmp_path, heading="before")
    for broken in (b"no picture", b"\x89PNG\r\n\x1a\n cut", b"GIF89a"):
        with pytest.raises(UserError, match="PNG"):
            written(tmp_path, sheets=[Picture(broken, "sheet")])
    with pytest.raises(UserError, match="same key"):
        written(tmp_path, tables=[TABLE], settings=[TABLE])
    folder = tmp_path / "report"
    assert [path.name for path in folder.iterdir()] == ["index.html"]
    assert (folder / "index.html").read_text() == before
