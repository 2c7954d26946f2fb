"""Files and folders that are written whole or not at all."""

import os

import pytest

from src.atomic import replacing, replacing_folder
from src.errors import UserError


@pytest.fixture
def results(tmp_path):
    """A folder of results that is there already, and holds one file."""
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "good").write_text("")
    return folder


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write_and_fail(path):
    path.write_text("")
    raise KeyError(path)


def test_a_file_takes_the_old_ones_place_when_it_is_whole(results):
    for text in ("first", "second"):
        with replacing(results / "new/file.csv") as temporary:
            temporary.write_text(text)
        assert (results / "new/file.csv").read_text() == text

    with pytest.raises(KeyError), replacing(results / "new/file.csv") as temporary:
        write_and_fail(temporary)
    assert (results / "new/file.csv").read_text() == "second"
    assert names(results / "new") == ["file.csv"]


def test_a_new_folder_takes_the_old_ones_place(tmp_path):
    folder = tmp_path / "results"
    for name in ("first", "second"):
        with replacing_folder(folder) as temporary:
            (temporary / name).write_text(name)
            assert not (folder / name).exists()
        assert names(folder) == [name]
    assert names(tmp_path) == ["results"]


def test_after_a_failure_the_old_folder_stands(results):
    with pytest.raises(KeyError), replacing_folder(results) as temporary:
        write_and_fail(temporary / "bad")
    assert names(results) == ["good"]
    assert names(results.parent) == ["results"]


@pytest.mark.parametrize("which", [1, 2])
def test_after_a_failed_rename_the_old_folder_stands(results, monkeypatch, which):
    rename, calls = os.rename, []

    def failing(source, target):
        calls.append(target)
        if len(calls) == which:
            raise OSError("disk gone")
        rename(source, target)

    monkeypatch.setattr(os, "rename", failing)
    failure = pytest.raises(UserError, match="results: cannot be written")
    with failure, replacing_folder(results) as temporary:
        (temporary / "bad").write_text("")
    assert names(results) == ["good"]
    assert names(results.parent) == ["results"]


def test_what_a_killed_process_had_put_aside_is_put_back(results):
    results.rename(results.with_name(".results.old"))
    with pytest.raises(KeyError), replacing_folder(results) as temporary:
        write_and_fail(temporary / "bad")
    assert names(results) == ["good"]


def test_what_a_killed_process_left_is_in_nobodys_way(tmp_path):
    """What was left yesterday goes; what is younger may be another process's work."""
    for name in ("1.new", "2.new", "old"):
        (tmp_path / f".results.{name}").mkdir()
        (tmp_path / f".results.{name}" / "left").write_text("")
    os.utime(tmp_path / ".results.1.new", (0, 0))
    with replacing_folder(tmp_path / "results") as temporary:
        assert names(temporary) == []
    assert names(tmp_path) == [".results.2.new", "results"]


def test_two_processes_do_not_write_into_each_other(tmp_path, monkeypatch):
    """The later one stays, and what it wrote is all that is there."""
    with replacing_folder(tmp_path / "results") as first:
        (first / "first").write_text("")
        monkeypatch.setattr(os, "getpid", lambda: 1)
        with replacing_folder(tmp_path / "results") as second:
            (second / "second").write_text("")
            assert names(first) == ["first"]
        assert names(tmp_path / "results") == ["second"]
    assert names(tmp_path / "results") == ["first"]
    assert names(tmp_path) == ["results"]
