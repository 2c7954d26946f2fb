"""Published runs: unpacked they give the report that the runs gave, and they are small."""

import shutil
import tarfile

import pytest

from src.errors import UserError
from src.report.run_group import APART
from src.results.counts import Counts
from src.results.runs import read_run, run_folders
from studies.cube.publish import main
from studies.settings import arguments_of
from tests.results.scored import write_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    run = write_run(folder, "baseline")
    shutil.copytree(run / "tallies", run / "attitude/tallies")
    (run / "attitude/attitude.csv").write_text("condition\ntrue\n")
    run = write_run(folder, "skyocc")
    (run / "metrics.csv").write_text("step,epoch\n1,0\n")
    (run / "checkpoints").mkdir()
    (run / "checkpoints/best.ckpt").write_text("heavy")
    return folder


@pytest.fixture
def publish():
    def publish(*words):
        arguments = arguments_of(main, [*map(str, words)])
        main(*arguments.args, **arguments.kwargs)

    return publish


def test_unpacked_runs_are_read_as_they_were(runs, publish, tmp_path):
    publish(runs, "--out", tmp_path / "runs.tar.xz")
    with tarfile.open(tmp_path / "runs.tar.xz") as archive:
        archive.extractall(folder := tmp_path / "runs", filter="data")
    for path in run_folders([folder], folder / "out"):
        own, there = read_run(path), read_run(runs / path.relative_to(folder))
        assert own.config == there.config
        assert own.code == there.code
        assert own.row.equals(there.row)
        assert set(own.counts.tables) == set(there.counts.tables) - set(APART)
        assert own.counts.scored_on_other(there.counts) == ""
    assert (folder / "skyocc/seed0/metrics.csv").is_file()
    assert not [*folder.rglob("*.ckpt")]
    further = folder / "baseline/seed0/attitude"
    assert Counts.read(further / "tallies/baseline.npz").name == "baseline"
    assert (further / "attitude.csv").read_text() == "condition\ntrue\n"
    assert len(list(folder.glob("*/seed0/tallies/all_free.npz"))) == 1

    publish(folder, "--out", tmp_path / "again.tar.xz")
    assert (tmp_path / "again.tar.xz").read_bytes() == (tmp_path / "runs.tar.xz").read_bytes()


def test_a_folder_without_a_finished_run_is_refused(runs, publish, tmp_path):
    (tmp_path / "skyocc/seed0").mkdir(parents=True)
    shutil.copy(runs / "skyocc/seed0/config.yaml", tmp_path / "skyocc/seed0")
    with pytest.raises(UserError, match="holds no finished run"):
        publish(tmp_path, "--out", tmp_path / "runs.tar.xz")
    assert not (tmp_path / "runs.tar.xz").exists()
