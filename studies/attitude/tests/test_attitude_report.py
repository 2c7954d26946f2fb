"""What task=report adds where runs were scored by tilt."""

import shutil

import pytest

from studies.attitude.tests.presented import write_attitude
from tests.report.typesetting import typeset
from tests.results.scored import write_ladder
from tests.tasks.test_report_task import KEYS, OF_PARTS, page_of, reported, table


@pytest.fixture
def runs(tmp_path):
    """The first two rungs of a ladder, scored by tilt."""
    runs = write_ladder(tmp_path / "runs/tiny", (0,), ("baseline", "attitude"))
    write_attitude(runs / "baseline/seed0")
    write_attitude(runs / "attitude/seed0", gain=0.4)
    return runs


@pytest.mark.slow
def test_a_paper_takes_its_tables_in(runs, tmp_path):
    write_ladder(runs, (0,), ("weights", "skyocc"))
    latex = (reported(runs) / "tables.tex").read_text()
    assert latex.count("\\label{") == len(KEYS) + 2 * len(OF_PARTS) + 3
    assert "Overfull" not in typeset(tmp_path, latex, ("booktabs", "graphicx", "hyperref"))


def test_scores_by_tilt_are_reported_where_they_are(runs):
    out = reported(runs)
    gains = table(out, "attitude_tilt").loc["+ Attitude-aware projection, over the baseline"]
    assert gains["0–5° (2 frames)"] == 0
    assert gains["from 5° (5 frames)"] > 5
    assert (out / "figures/attitude.png").stat().st_size > 1000
    assert "(figures/attitude.png)" in page_of(out)
    assert "data:image/png" in (out / "report.html").read_text()
    for folder in runs.glob("*/seed0/attitude"):
        shutil.rmtree(folder)
    reported(runs)
    assert not list(out.glob("*/attitude*"))
