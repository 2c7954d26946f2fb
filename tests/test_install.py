"""The installation: what it believes, what it refuses, and that each refusal is one line."""

import ast
import os
import shutil
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import install
from tests.sessions import ROOT

FILES = ("install.py", "pyproject.toml", "constraints.txt", "Makefile")


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout in which nothing has been installed."""
    root = tmp_path / "checkout"
    root.mkdir()
    for name in FILES:
        shutil.copy(ROOT / name, root)
    venv = root / ".venv"
    paths = {
        "ROOT": root,
        "VENV": venv,
        "STAMP": venv / ".ready",
        "OWN_PYTHON": venv / "bin/python",
    }
    for name, path in paths.items():
        monkeypatch.setattr(install, name, path)
    monkeypatch.delenv("PYTHON", raising=False)
    return root


@pytest.fixture
def pretended(tmp_path):
    """Makes a program that answers as a Python of some version does."""

    def python(version, has_venv=True, name="python3.99"):
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(
            f"#!/bin/sh\necho {version}\n{'echo with venv' if has_venv else 'exit 1'}\n"
        )
        path.chmod(0o755)
        return str(path)

    return python


def make(checkout, target="setup", **variables):
    """Runs make in a checkout; returns its status and the errors, without those of make itself."""
    environment = {**os.environ, **variables}
    done = subprocess.run(
        ["make", target], cwd=checkout, env=environment, capture_output=True, text=True, timeout=60
    )
    # Of make itself, which counts how deep it is where it runs these tests: "make[1]: ***".
    lines = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    return done.returncode, lines


# ----------------------------------------------------------------------------- which Python


def test_an_unsupported_python_is_refused_by_its_version_before_anything_is_made(
    checkout, pretended
):
    status, (line,) = make(checkout, PYTHON=pretended("3.9.18"))
    assert status != 0
    assert "is Python 3.9.18" in line
    assert "3.10 to 3.13" in line
    assert not (checkout / ".venv").exists()


def test_an_interpreter_that_cannot_be_used_is_refused(pretended):
    for python, named in (
        ("/nowhere/python3.11", "^PYTHON=/nowhere/python3.11 cannot be run"),
        (pretended("3.14.0", name="new"), r"is Python 3\.14\.0"),
        (pretended("3.12.7", has_venv=False), "python3.12-venv"),
    ):
        with pytest.raises(install.Refusal, match=named):
            install.interpreter(python)


def test_without_any_python_this_is_said(checkout, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty/make").symlink_to(shutil.which("make"))
    status, (line,) = make(checkout, PATH=str(tmp_path / "empty"))
    assert status != 0
    assert line == "error: no Python here; install python3.11 with its module venv, or uv"


def test_the_first_supported_one_is_taken_and_the_others_are_listed(
    checkout, pretended, monkeypatch
):
    names = [pretended("3.9.1", name="old"), pretended("3.12.2", name="good")]
    monkeypatch.setattr(install, "NAMES", names)
    monkeypatch.setattr(sys, "_base_executable", names[0], raising=False)
    assert install.interpreter("") == (names[1], "3.12.2")
    monkeypatch.setattr(install, "NAMES", names[:1])
    with pytest.raises(install.Refusal, match=r"only 3\.9\.1;"):
        install.interpreter("")


# ----------------------------------------------------------------------------- which machine


@pytest.mark.parametrize(
    ("system", "machine", "libc", "named"),
    [
        ("Linux", "ppc64le", ("glibc", "2.36"), "Linux on ppc64le"),
        ("Linux", "aarch64", ("glibc", "2.27"), r"glibc 2\.27"),
        ("Darwin", "arm64", ("", ""), "Darwin on arm64.*container with Linux"),
        ("Linux", "x86_64", ("", ""), "not glibc"),
        ("Linux", "x86_64", ("glibc", "2.17"), "glibc 2.17"),
    ],
)
def test_a_machine_without_wheels_is_refused(monkeypatch, system, machine, libc, named):
    monkeypatch.setattr(install.platform, "system", lambda: system)
    monkeypatch.setattr(install.platform, "machine", lambda: machine)
    monkeypatch.setattr(install.platform, "libc_ver", lambda: libc)
    with pytest.raises(install.Refusal, match=named) as refusal:
        install.require_platform()
    assert "\n" not in str(refusal.value)


@pytest.fixture
def on_arm(monkeypatch):
    """Linux on a small ARM machine, as a Jetson."""
    monkeypatch.setattr(install.platform, "system", lambda: "Linux")
    monkeypatch.setattr(install.platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(install.platform, "libc_ver", lambda: ("glibc", "2.35"))


def test_without_what_draws_an_installation_goes_on_and_says_what_works(
    on_arm, installed, monkeypatch, capsys
):
    # Absent here, as this machine may have the real ones; one name stands for what is there.
    monkeypatch.setattr(install, "RENDERERS", ("absent_bullet", "json", "absent_embree"))
    assert installed() == ["made", "installed "]
    *_, line = capsys.readouterr().out.splitlines()
    assert line.startswith("setup: absent_bullet and absent_embree, which draw data")
    no, yes = line.split(" do not work here")
    assert {"task=generate", "look", "fly", "annotate"} <= {*no.replace(",", "").split()}
    assert {"streams", "predict", "score", "paths.dataset=DIR"} <= {*yes.replace(",", "").split()}

    assert installed() == []
    assert capsys.readouterr().out.splitlines() == [line], "a task that must draw points here"
    monkeypatch.setattr(install, "RENDERERS", ("json",))
    assert installed() == []
    assert capsys.readouterr().out == ""


def test_pyproject_asks_for_what_draws_where_there_are_wheels_alone():
    listed = [Requirement(line) for line in requires("skyshield")]
    for machine, python, expected in (
        ("x86_64", "3.11", {"pybullet", "embreex"}),
        ("x86_64", "3.13", {"pybullet-arm64", "embreex"}),
        ("aarch64", "3.11", set()),
        ("aarch64", "3.13", set()),
    ):
        here = {"platform_machine": machine, "python_version": python, "extra": ""}
        wanted = {each.name for each in listed if not each.marker or each.marker.evaluate(here)}
        assert wanted & {"pybullet", "pybullet-arm64", "embreex"} == expected
        assert "torch" in wanted


def test_a_full_disk_is_refused_before_pip_fills_it(checkout, monkeypatch):
    usage = shutil.disk_usage(checkout)._replace(free=10**9)
    monkeypatch.setattr(install.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(install.Refusal, match=r"1\.0 GB are free"):
        install.make_venv(sys.executable, "3.11.0")
    assert not (checkout / ".venv").exists()


def test_a_checkout_that_cannot_be_written_to_is_refused(checkout, monkeypatch):
    monkeypatch.setattr(install.os, "access", lambda path, mode: False)
    with pytest.raises(install.Refusal, match="cannot be written to"):
        install.main("")


# ----------------------------------------------------------------------------- what is believed


@pytest.fixture
def installed(checkout, monkeypatch):
    """Installs as often as it must, without pip; returns what was done each time."""
    done = []

    def make_venv(python, version):
        done.append("made")
        install.OWN_PYTHON.parent.mkdir(parents=True, exist_ok=True)
        install.OWN_PYTHON.unlink(missing_ok=True)
        install.OWN_PYTHON.symlink_to(sys.executable)

    monkeypatch.setattr(install, "make_venv", make_venv)
    monkeypatch.setattr(install, "install", lambda extra: done.append(f"installed {extra}"))

    def called(extra=""):
        done.clear()
        install.main(extra)
        return list(done)

    return called


def test_a_whole_one_is_left_alone_and_what_is_listed_anew_is_added(installed, checkout):
    assert installed() == ["made", "installed "]
    assert installed() == []
    assert installed("dev") == ["installed dev"]
    assert installed() == installed("dev") == []
    (checkout / "constraints.txt").write_text("torch==99\n")
    assert installed() == ["installed "]


def test_one_that_was_not_finished_or_whose_python_is_gone_is_made_again(installed, monkeypatch):
    installed()
    install.STAMP.unlink()
    assert installed() == ["made", "installed "]
    install.OWN_PYTHON.unlink()
    install.OWN_PYTHON.symlink_to("/removed/python3.11")
    assert installed() == ["made", "installed "]

    def interrupted(extra):
        raise KeyboardInterrupt

    (install.ROOT / "constraints.txt").write_text("torch==99\n")
    monkeypatch.setattr(install, "install", interrupted)
    with pytest.raises(KeyboardInterrupt):
        install.main("")
    assert not install.STAMP.exists(), "it is not believed after an interruption"


def test_one_of_another_python_than_the_one_asked_for_is_made_again(
    installed, pretended, monkeypatch
):
    installed()
    monkeypatch.setenv("PYTHON", sys.executable)
    assert installed() == []
    monkeypatch.setenv("PYTHON", pretended("3.13.7"))
    assert installed() == ["made", "installed "]


# ----------------------------------------------------------------------------- what pip fails at


@pytest.mark.parametrize(
    ("told", "cause"),
    [
        ("ERROR: Could not install packages: [Errno 28] No space left on device", "disk is full"),
        ("OSError: [Errno 30] Read-only file system: '/x'", "is read-only"),
        ("ERROR: [Errno 13] Permission denied: '/x'", "no permission"),
        ("WARNING: Retrying (total=4) after connection broken by 'NewConnectionError", "network"),
        ("WARNING: Retrying after 'ProxyError('Cannot connect to proxy.'", "proxy does not answer"),
        ("SSLError(SSLCertVerificationError(1, '[SSL: CERTIFICATE_VERIFY_FAILED]", "PIP_CERT"),
        ("ERROR: No matching distribution found for torch>=2.5\nhint", "has no torch;"),
        ("something new", "pip failed, as told above"),
    ],
)
def test_a_failure_of_pip_is_told_in_one_line_that_says_what_to_do(told, cause):
    line = install.cause_of(told)
    assert cause in line
    assert line.endswith(install.GO_ON)
    assert "\n" not in line


def test_variables_that_pip_reads_are_named_without_their_passwords(monkeypatch):
    for name in (*install.INDEXES, *install.PROXIES):
        monkeypatch.delenv(name, raising=False)
    assert "(" not in install.cause_of("Retrying")
    monkeypatch.setenv("PIP_INDEX_URL", "https://me:secret@example.org/simple")
    line = install.cause_of("Retrying")
    assert "PIP_INDEX_URL=https://***@example.org/simple" in line
    assert "secret" not in line


def test_it_can_be_read_by_old_pythons():
    """So that these can say which one is needed: its syntax is that of Python 3.6."""
    ast.parse(Path(install.__file__).read_text(), feature_version=(3, 6))
