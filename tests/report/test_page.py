"""The pages as files: whole, by themselves, and safe against whatever a run is called."""

import dataclasses
import re

import pytest
from PIL import Image
from plotly.graph_objects import Figure, Scatter
from plotly.offline import get_plotlyjs

from src.errors import UserError
from src.report.ladder_report import ladder_report
from src.report.report_page import learning_curves, write_report_pages
from src.report.run_group import group_of
from src.results.counts import parts_of
from tests.report.street import SMALL, scene_of
from tests.results.scored import ladder_of, write_ladder
from tests.results.test_render import TABLE

WICKED = "</script><script>alert('x')</script><img src=x onerror=alert(1)>{{ plotly }}"


@pytest.fixture(name="report", scope="module")
def _report(tmp_path_factory):
    """What a report of two rungs says."""
    folder = tmp_path_factory.mktemp("runs")
    runs = ladder_of(write_ladder(folder, seeds=(0,), experiments=("baseline", "skyocc")))
    group = group_of(runs)
    assert learning_curves(group) == [], "no run has a log"
    return ladder_report(group, [], parts_of, folder)


def written(folder, report, plots=(), figures=None, scenes=()):
    """The page without plotly's own script."""
    write_report_pages(report, plots, figures or {}, scenes, folder)
    return (folder / "report.html").read_text().replace(get_plotlyjs(), "ITS SCRIPT")


@pytest.fixture(name="content", scope="module")
def _content(report, tmp_path_factory):
    """All that a page can have."""
    folder, figures = tmp_path_factory.mktemp("page"), {}
    for kind in ("png", "jpg"):
        Image.new("RGB", (60, 40)).save(folder / f"sheet.{kind}")
        figures[folder / f"sheet.{kind}"] = f"a sheet as {kind}"
    missing = dataclasses.replace(report, missing=("attitude seed 1: no run",))
    plots = [("Loss", Figure(Scatter(y=[2.0, 1.0])))]
    return folder, missing, plots, figures, [scene_of(SMALL)]


@pytest.fixture(name="whole", scope="module")
def _whole(content):
    return written(*content)


def test_the_page_needs_nothing_but_itself(whole, content):
    addresses = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', whole)
    kinds = [re.match(r"data:image/(\w+);base64,", each).group(1) for each in addresses]
    assert kinds == ["png", "jpeg"]
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(|\{[{%]", whole)
    assert "default-src 'none'" in whole, "what is forgotten here, the browser refuses"
    assert whole.count("ITS SCRIPT") == 1
    assert written(*content) == whole, "the same content, the same bytes"


def test_it_has_the_tables_the_curves_the_scenes_and_the_pictures(whole, report):
    titles = re.findall(r"<h2>(.*?)</h2>", whole)
    assert titles == ["Missing", "Facts", "Tables", "Loss", "Scenes"]
    for words in ("attitude seed 1: no run", "a sheet as jpg", *(t.title for t in report.tables)):
        assert words in whole
    assert whole.count('class="plotly-graph-div"') == 2


def test_a_table_shows_its_intervals_its_best_and_its_lines(whole, report):
    main = next(table for table in report.tables if table.key == "main")
    section = whole.split(f"<h3>{main.title}</h3>")[1].split("</section>")[0]
    assert re.findall(r"<tr[^>]*><th>(.*?)</th><td", section) == [name for name, _ in main.rows]
    assert section.count('class="line"') == len(main.lines)
    for (_, shown), line in zip(main.shown(), section.split("</tr>")[1:]):
        for cell, text in zip(shown, re.findall("<td>(.*?)</td>", line)):
            number = f"<b>{cell.text}</b>" if cell.is_best else cell.text
            assert text == f"{number}<br><small>[{', '.join(cell.bounds)}]</small>"


def test_what_is_empty_is_left_out(report, tmp_path):
    page = written(tmp_path, dataclasses.replace(report, missing=()))
    assert re.findall(r"<h2>(.*?)</h2>", page) == ["Facts", "Tables"]
    assert "ITS SCRIPT" not in page, "4.8 MB for nothing"


def test_no_name_becomes_markup(whole, content):
    folder, report, plots, figures, scenes = content
    scene = scene_of(SMALL, title=WICKED, predictions={WICKED: scenes[0].truth})
    texts = {"title": WICKED, "caption": WICKED, "head": WICKED, "columns": [WICKED]}
    table = dataclasses.replace(report.tables[0], **texts, rows=[(WICKED, [WICKED])])
    wicked = dataclasses.replace(report, heading=WICKED, tables=(table,), missing=(WICKED,))
    plots, figures = [(WICKED, plots[0][1])], dict.fromkeys(figures, WICKED)
    page = written(folder, wicked, plots, figures, [scene])
    for tag in ("<script", "</script"):
        assert page.count(tag) == whole.count(tag)
    assert "<img src=x" not in page
    assert page.count("&lt;/script&gt;") > 8


def test_the_text_shows_every_column_and_interval_and_marks_the_best(report, tmp_path):
    written(tmp_path, dataclasses.replace(report, facts=(), tables=(TABLE,)))
    text = (tmp_path / "report.md").read_text().split("## Files")[0]
    rows = [line for line in text.splitlines() if line.startswith("|")]
    # Bars that are escaped end no cell.
    cells = [[c.strip() for c in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows]
    assert {len(row) for row in cells} == {1 + len(TABLE.columns)}
    baseline, nasty, other, gain = cells[-len(TABLE.rows) :]
    assert baseline == ["Baseline", "✗", "0.33 [0.10, 0.70]", "**0.00**", "80.00 [70.00, 95.50]"]
    assert nasty[2:] == ["**25.09** [20.00, 30.00]", "-1.50 [-3.00, 0.00]", "**7.00** [1.00, 9.00]"]
    assert other[2:] == ["–", "", "10.00"]
    assert gain[2] == "+99.00 [+98.00, +99.50]"


def test_a_page_that_cannot_be_written_is_refused(report, tmp_path):
    (tmp_path / "report.html").mkdir()
    with pytest.raises(UserError, match=r"report\.html"):
        written(tmp_path, report)
