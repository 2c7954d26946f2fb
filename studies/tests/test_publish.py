"""A study as one file: read back as it was, and anything else refused."""

import shutil
import zipfile

import pytest

from src.errors import UserError
from src.results.archive import publish_runs, unpacked
from src.results.counts import Counts
from src.results.runs import read_run, run_folders
from tests.results.scored import write_run

WITHOUT = ("breakdown", "calibration")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    run = write_run(folder, "baseline")
    shutil.copytree(run / "tallies", run / "attitude/tallies")
    (run / "attitude/attitude.csv").write_text("condition\ntrue\n")
    (write_run(folder, "skyocc") / "metrics.csv").write_text("step,epoch\n1,0\n")
    return folder


@pytest.fixture
def archive(runs, tmp_path):
    path = tmp_path / "study/runs.zip"
    publish_runs([[read_run(each) for each in run_folders([runs], runs / "out")]], path, WITHOUT)
    return path


@pytest.mark.parametrize("name", ["runs.zip", "runs", "runs.zip/", "./runs"])
def test_an_archive_is_read_by_its_name_with_or_without_its_ending(archive, runs, name):
    with unpacked([archive.parent / name]) as ((folder,), _):
        for path in run_folders([folder], folder / "out"):
            own, there = read_run(path), read_run(runs / path.relative_to(folder))
            assert own.config == there.config
            assert own.code == there.code
            assert own.row.equals(there.row)
            assert set(own.counts.tables) == set(there.counts.tables) - set(WITHOUT)
            assert own.counts.scored_on_other(there.counts) == ""
        assert (folder / "skyocc/seed0/metrics.csv").is_file()
        further = folder / "baseline/seed0/attitude"
        assert Counts.read(further / "tallies/baseline.npz").name == "baseline"
        assert (further / "attitude.csv").read_text() == "condition\ntrue\n"
        assert len(list(folder.glob("*/seed0/tallies/all_free.npz"))) == 1
    assert not folder.exists()


def test_a_place_in_an_archive_is_found_and_a_folder_of_the_name_comes_first(archive, runs):
    with unpacked([archive.parent / "runs/skyocc/seed0"]) as ((folder,), named):
        assert read_run(folder).experiment == "skyocc"
        assert named(f"{folder}: wrong") == f"{archive}/skyocc/seed0: wrong"
    shutil.copytree(runs, archive.parent / "runs")
    with unpacked([archive.parent / "runs"]) as (places, _):
        assert places == [archive.parent / "runs"]


def test_errors_name_the_archive_and_not_where_it_was_unpacked(archive):
    def fail():
        with unpacked([archive]) as ((folder,), _):
            raise UserError(f"{folder}/skyocc/seed0: is broken")

    with pytest.raises(UserError, match=r"study/runs\.zip/skyocc/seed0: is broken$"):
        fail()


def test_the_same_runs_give_the_same_bytes(archive, runs, tmp_path):
    with unpacked([archive]) as ((folder,), _):
        again = [read_run(each) for each in run_folders([folder], folder / "out")]
        publish_runs([again], tmp_path / "again.zip", WITHOUT)
        publish_runs([again], archive, WITHOUT)
    assert archive.read_bytes() == (tmp_path / "again.zip").read_bytes()


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b"no archive"),
        lambda path: path.write_bytes(path.read_bytes()[:5000]),
        lambda path: path.write_bytes(path.read_bytes().replace(b"XZ", b"ZZ")[:-1]),
    ],
)
def test_what_is_no_archive_is_refused_in_one_line(archive, damage):
    damage(archive)
    said = r"runs\.zip: is no archive of a study \(.*task\.publish"
    refused = pytest.raises(UserError, match=said)
    with refused as error, unpacked([archive]):
        pass
    assert "\n" not in str(error.value)


def test_an_archive_of_something_else_or_of_too_much_is_refused(archive, tmp_path, monkeypatch):
    other = tmp_path / "other.zip"
    with zipfile.ZipFile(other, "w") as file:
        file.writestr("readme.txt", "x")
    with pytest.raises(UserError, match=r"other\.zip: is no archive of a study"), unpacked([other]):
        pass
    monkeypatch.setattr("src.results.archive.LARGEST", 1000)
    with pytest.raises(UserError, match=r"more than 1,000 bytes"), unpacked([archive]):
        pass
