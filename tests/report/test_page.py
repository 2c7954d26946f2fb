"""The page as a file: whole, by itself, and safe against whatever a run is called."""

import dataclasses
import re

import pytest
from PIL import Image
from plotly.offline import get_plotlyjs

from src.errors import UserError
from src.report.curve_plot import Curve, CurvePlot
from src.report.ladder_report import ladder_report
from src.report.report_page import write_report_page
from src.report.run_group import group_of
from src.tasks.scoring import parts_of
from tests.report.test_scene_figure import SMALL, scene_of
from tests.results.scored import ladder_of, write_ladder

PLOT = CurvePlot("Loss", "", (Curve("a", (1, 2), (2.0, 1.0)),))
WICKED = "</script><script>alert('x')</script><img src=x onerror=alert(1)>{{ plotly }}"


@pytest.fixture(name="report", scope="module")
def _report(tmp_path_factory):
    """What a report of two rungs says."""
    folder = tmp_path_factory.mktemp("runs")
    runs = ladder_of(write_ladder(folder, seeds=(0,), experiments=("baseline", "skyocc")))
    return ladder_report(group_of(runs), [], parts_of, folder)


def written(folder, report, heading="Report", plots=(), figures=None, scenes=()):
    """The page without plotly's own script."""
    path = folder / "report.html"
    write_report_page(report, heading, plots, figures or {}, scenes, path)
    return path.read_text(encoding="utf-8").replace(get_plotlyjs(), "ITS SCRIPT")


@pytest.fixture(name="whole", scope="module")
def _whole(report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    figures = {}
    for kind in ("png", "jpg"):
        Image.new("RGB", (60, 40)).save(folder / f"sheet.{kind}")
        figures[folder / f"sheet.{kind}"] = f"a sheet as {kind}"
    missing = dataclasses.replace(report, missing=("attitude seed 1: no run",))
    return written(folder, missing, "Heading", [PLOT], figures, [scene_of(SMALL)])


def test_the_page_needs_nothing_but_itself(whole):
    addresses = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', whole)
    kinds = [re.match(r"data:image/(\w+);base64,", each).group(1) for each in addresses]
    assert kinds == ["png", "jpeg"]
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", whole)
    assert "default-src 'none'" in whole, "what is forgotten here, the browser refuses"
    assert whole.count("ITS SCRIPT") == 1
    assert not re.search(r"\{[{%]", whole)


def test_it_has_the_tables_the_curves_the_scenes_and_the_pictures(whole, report):
    titles = re.findall(r"<h2>(.*?)</h2>", whole)
    assert titles == ["Missing", "Facts", "Tables", "Loss", "Scenes"]
    for words in ("attitude seed 1: no run", "a sheet as jpg", *(t.title for t in report.tables)):
        assert words in whole
    assert whole.count('class="plotly-graph-div"') == 2


def test_a_table_shows_its_intervals_its_best_and_its_lines(whole, report):
    main = report.table("main")
    section = whole.split(f"<h3>{main.title}</h3>")[1].split("</section>")[0]
    assert re.findall(r"<tr[^>]*><th>(.*?)</th><td", section) == [name for name, _ in main.rows]
    assert section.count('class="line"') == len(main.lines)
    for (_, shown), line in zip(main.shown(), section.split("</tr>")[1:]):
        for cell, text in zip(shown, re.findall("<td>(.*?)</td>", line)):
            number = f"<b>{cell.text}</b>" if cell.is_best else cell.text
            assert text == f"{number}<br><small>[{', '.join(cell.bounds)}]</small>"


def test_what_is_empty_is_left_out(report, tmp_path):
    report = dataclasses.replace(report, missing=())
    page = written(tmp_path, report, plots=[CurvePlot("Loss", "", (Curve("a", (), ()),))])
    assert re.findall(r"<h2>(.*?)</h2>", page) == ["Facts", "Tables"]
    assert "ITS SCRIPT" not in page, "4.8 MB for nothing"


def test_no_name_becomes_markup(report, tmp_path):
    scene = scene_of(SMALL)
    wicked_scene = scene_of(SMALL, title=WICKED, predictions={WICKED: scene.truth})
    plots = [CurvePlot(name, name, (Curve(name, (1,), (1.0,)),)) for name in ("a", WICKED)]
    Image.new("RGB", (60, 40)).save(sheet := tmp_path / "sheet.png")
    table = dataclasses.replace(
        report.tables[0],
        title=WICKED,
        caption=WICKED,
        head=WICKED,
        columns=[WICKED],
        rows=[(WICKED, [WICKED])],
    )
    wicked = dataclasses.replace(report, tables=(table,), missing=(WICKED,))
    harmless = written(tmp_path, report, "a", plots[:1], {}, [scene])
    page = written(tmp_path, wicked, WICKED, plots[1:], {sheet: WICKED}, [wicked_scene])
    assert page.count("<script") == harmless.count("<script")
    assert page.count("</script") == harmless.count("</script")
    assert "<img src=x" not in page
    assert page.count("&lt;/script&gt;") > 8


def test_the_same_content_gives_the_same_bytes(report, tmp_path):
    content = {"plots": [PLOT], "scenes": [scene_of(SMALL)]}
    assert written(tmp_path, report, **content) == written(tmp_path, report, **content)


def test_a_page_that_cannot_be_written_is_refused(report, tmp_path):
    (tmp_path / "report.html").mkdir()
    with pytest.raises(UserError, match=r"report\.html"):
        written(tmp_path, report)
