"""Folders of results that are written whole or not at all."""

import pytest

from src.atomic_folder import replacing_folder


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write_and_fail(path):
    path.write_text("")
    raise KeyError(path)


def test_a_new_folder_takes_the_old_ones_place(tmp_path):
    folder = tmp_path / "results"
    for name in ("first", "second"):
        with replacing_folder(folder) as temporary:
            (temporary / name).write_text(name)
            assert not (folder / name).exists()
        assert names(folder) == [name]
    assert names(tmp_path) == ["results"]


def test_after_a_failure_the_old_folder_stands(tmp_path):
    folder = tmp_path / "results"
    with replacing_folder(folder) as temporary:
        (temporary / "good").write_text("")
    with pytest.raises(KeyError), replacing_folder(folder) as temporary:
        write_and_fail(temporary / "bad")
    assert names(folder) == ["good"]
    assert names(tmp_path) == ["results"]


def test_what_a_killed_process_left_is_in_nobodys_way(tmp_path):
    for kind in ("new", "old"):
        (tmp_path / f".results.{kind}").mkdir()
        (tmp_path / f".results.{kind}" / "left").write_text("")
    with replacing_folder(tmp_path / "results") as temporary:
        assert names(temporary) == []
    assert names(tmp_path) == ["results"]
