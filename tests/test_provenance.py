"""Where a number comes from: the digest of plain data, the commit and the machine."""

import os
import platform
import subprocess

import pytest

from src import provenance
from src.provenance import digest_of, git_commit


def test_equal_data_have_equal_digests_whatever_their_order():
    assert digest_of({"a": 1, "b": [2, 3]}) == digest_of({"b": [2, 3], "a": 1})
    assert digest_of({"a": 1}) != digest_of({"a": 2})
    assert len(digest_of({})) == 12


def test_the_commit_says_whether_files_were_changed(tmp_path, monkeypatch):
    def git(*words):
        name = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *name, *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    monkeypatch.setattr(provenance, "SOURCE", tmp_path / "src")
    (tmp_path / "src").mkdir()
    assert git_commit() == "", "outside a checkout"
    git("init")
    (tmp_path / "a.py").write_text("A = 1\n")
    git("add", "a.py")
    git("commit", "--no-verify", "-m", "one")
    clean = git_commit()
    assert len(clean) == 12
    (tmp_path / "a.py").write_text("A = 2\n")
    assert git_commit() == clean + "+"

    # An unpacked archive inside that repository is not of its commit.
    (tmp_path / "vendor/skyshield/src").mkdir(parents=True)
    monkeypatch.setattr(provenance, "SOURCE", tmp_path / "vendor/skyshield/src")
    assert git_commit() == ""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a checkout to another user")
def test_the_commit_of_another_user_s_checkout_is_known(tmp_path, monkeypatch):
    """As in a container, where git calls it dubious and says nothing of it."""
    for words in (["init"], ["commit", "--allow-empty", "--no-verify", "-m", "one"]):
        name = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *name, *words], cwd=tmp_path, check=True, capture_output=True)
    (tmp_path / "src").mkdir()
    for path in (tmp_path, tmp_path / ".git", tmp_path / "src"):
        os.chown(path, 65534, 65534)
    monkeypatch.setattr(provenance, "SOURCE", tmp_path / "src")
    assert len(git_commit()) == 12


def test_the_machine_is_told_with_its_cores_and_python():
    name, cores, python = provenance.machine().rsplit(", ", 2)
    assert name
    assert cores == f"{len(os.sched_getaffinity(0))} cores"
    assert python == f"Python {platform.python_version()}"
