"""What task=report adds where runs were scored by tilt."""

import shutil

import pytest

from studies.attitude.tests.presented import write_attitude
from tests.report.typesetting import typeset
from tests.results.scored import write_ladder, write_run
from tests.tasks.test_report_task import KEYS, OF_PARTS, page_of, reported, table


@pytest.fixture(scope="module")
def ladder(tmp_path_factory):
    """A finished ladder; not to be changed."""
    return write_ladder(tmp_path_factory.mktemp("runs") / "tiny", seeds=(0,))


@pytest.fixture
def runs(ladder, tmp_path):
    """A copy of the ladder that a test may change."""
    return shutil.copytree(ladder, tmp_path / "runs/tiny")


@pytest.mark.slow
def test_a_paper_takes_its_tables_in(ladder, tmp_path):
    write_attitude(shutil.copytree(ladder, tmp_path / "runs/tiny") / "skyocc/seed0")
    out = reported(tmp_path / "runs/tiny", out=tmp_path / "out")
    latex = (out / "tables.tex").read_text()
    assert latex.count("\\label{") == len(KEYS) + 2 * len(OF_PARTS) + 3
    assert "Overfull" not in typeset(tmp_path, latex, ("booktabs", "graphicx", "hyperref"))


def test_scores_by_tilt_are_reported_where_they_are(runs, tmp_path):
    write_attitude(runs / "baseline/seed0")
    write_attitude(runs / "attitude/seed0", gain=0.4)
    out = reported(runs)
    gains = table(out, "attitude_tilt").loc["+ Attitude-aware projection, over the baseline"]
    assert gains["0–5° (2 frames)"] == 0
    assert gains["from 5° (5 frames)"] > 5
    assert (out / "figures/attitude.png").stat().st_size > 1000
    assert "(figures/attitude.png)" in page_of(out)
    assert "data:image/png" in (out / "report.html").read_text()
    shutil.rmtree(runs / "baseline/seed0/attitude")
    shutil.rmtree(runs / "attitude/seed0/attitude")
    reported(runs)
    assert not list(out.glob("*/attitude*"))


def test_scores_by_tilt_of_rungs_without_a_common_seed_have_no_gains(tmp_path):
    """Also where there are more experiments than colors."""
    runs = tmp_path / "runs/tiny"
    write_attitude(write_run(runs, "baseline", 0))
    for name in ("attitude", *(f"own{n}" for n in range(8))):
        write_attitude(write_run(runs, name, 1))
    out = reported(runs)
    assert (out / "figures/attitude.png").is_file()
    scored = table(out, "attitude_tilt")["0–5° (2 frames)"].notna()
    gains = scored.index.str.endswith("over the baseline")
    assert gains.sum() == 9
    assert (scored == ~gains).all()
