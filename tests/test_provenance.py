"""Where a number comes from: the digest of plain data, the commit and the machine."""

import os
import platform
import subprocess

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
    monkeypatch.setattr(provenance, "SOURCE", tmp_path)
    assert git_commit() == "", "outside a checkout"
    git("init")
    (tmp_path / "a.py").write_text("A = 1\n")
    git("add", "a.py")
    git("commit", "--no-verify", "-m", "one")
    clean = git_commit()
    assert len(clean) == 12
    (tmp_path / "a.py").write_text("A = 2\n")
    assert git_commit() == clean + "+"


def test_the_machine_is_told_with_its_cores_and_python():
    name, cores, python = provenance.machine().rsplit(", ", 2)
    assert name
    assert cores == f"{len(os.sched_getaffinity(0))} cores"
    assert python == f"Python {platform.python_version()}"
