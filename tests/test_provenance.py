"""Where a number comes from."""

import os
import platform
import subprocess

import pytest

from src import provenance
from src.provenance import code_digest, code_version, digest_of, git_commit, package_versions


def test_equal_data_have_equal_digests_whatever_their_order():
    assert digest_of({"a": 1, "b": [2, 3]}) == digest_of({"b": [2, 3], "a": 1})
    assert digest_of({"a": 1}) != digest_of({"a": 2})
    assert len(digest_of({})) == 12


@pytest.fixture
def digest_after(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "SOURCE", tmp_path)

    def digest(text, name="part.py"):
        for old in tmp_path.glob("*.py"):
            old.unlink()
        (tmp_path / name).write_text(text)
        return code_digest([tmp_path])

    return digest


CODE = 'def f(x):\n    """Doubles."""\n    return 2 * x\n'


@pytest.mark.parametrize(
    "text",
    [
        'def f(x):\n    """Gives twice x."""\n    return 2 * x\n',
        '"""A module."""\n\ndef f(x):\n    # why\n    return 2 * x\n',
        "def f(x):\n    return (\n        2 * x\n    )\n",
    ],
)
def test_words_and_layout_do_not_count(digest_after, text):
    assert digest_after(text) == digest_after(CODE)


@pytest.mark.parametrize(
    "text", [CODE.replace("2 *", "3 *"), CODE + "X = 1\n", CODE.replace("f(x)", "f(x, y=0)")]
)
def test_statements_count(digest_after, text):
    assert digest_after(text) != digest_after(CODE)


def test_a_file_s_place_counts(digest_after):
    assert digest_after(CODE, "other.py") != digest_after(CODE)


def test_a_text_that_is_a_value_counts(digest_after):
    assert digest_after('NAME = "a"\n') != digest_after('NAME = "b"\n')


def test_the_version_of_a_result_is_code_and_configuration(digest_after):
    digest_after(CODE)
    before = code_version({"seed": 0})
    assert code_version({"seed": 1}) != before
    digest_after(CODE + "X = 1\n")
    assert code_version({"seed": 0}) != before


def test_the_commit_says_whether_files_were_changed(tmp_path, monkeypatch):
    def git(*words):
        name = ("-c", "user.name=n", "-c", "user.email=e@example.org")
        subprocess.run(["git", *name, *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(provenance, "SOURCE", tmp_path)
    git("init")
    (tmp_path / "a.py").write_text("A = 1\n")
    git("add", "a.py")
    git("commit", "--no-verify", "-m", "one")
    clean = git_commit()
    assert len(clean) == 12
    (tmp_path / "a.py").write_text("A = 2\n")
    assert git_commit() == clean + "+"


def test_outside_a_checkout_the_commit_is_empty(tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    monkeypatch.setattr(provenance, "SOURCE", tmp_path)
    assert git_commit() == ""


def test_versions_of_absent_packages_are_left_out(monkeypatch):
    monkeypatch.setattr(provenance, "PACKAGES", ("torch", "no-such-package"))
    assert set(package_versions()) == {"torch"}


def test_the_machine_is_told_with_its_cores_and_python():
    told = provenance.machine()
    assert f"{len(os.sched_getaffinity(0))} cores" in told
    assert f"Python {platform.python_version()}" in told
    assert not told.startswith(",")
