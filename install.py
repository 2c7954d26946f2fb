"""Makes ``.venv`` with all that SkyShield needs: ``make setup`` calls it, under any Python 3.

``install.py dev`` adds what the tests need. The variable PYTHON names an interpreter for ``.venv``
other than the one that is found. Standard library alone: nothing is installed yet.
"""

import fcntl
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
OWN_PYTHON = VENV / "bin/python"
# Written last: a ``.venv`` without it was not finished.
STAMP = VENV / ".ready"

NAMES = ("python3.11", "python3.12", "python3.13", "python3.10", "python3")
SUPPORTED = ("3.10.", "3.11.", "3.12.", "3.13.")
PROBE = """
import sys
print("%d.%d.%d" % sys.version_info[:3])
import ensurepip, venv
print("with venv")
"""

MACHINES = ("x86_64", "aarch64")
# What draws the data: these have wheels for Linux on x86_64 alone, where pyproject.toml lists them.
RENDERERS = ("pybullet", "embreex")
LOOK_FOR = """
import sys
from importlib.util import find_spec
print(*(name for name in sys.argv[1:] if find_spec(name) is None))
"""

FREE_GB = 3.0
# Variables that pip reads, any of which may be what is wrong.
INDEXES = ("PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_NO_INDEX")
PROXIES = ("PIP_PROXY", "https_proxy", "HTTPS_PROXY", "http_proxy", "HTTP_PROXY", "ALL_PROXY")
GO_ON = "then the same command goes on"


class Refusal(Exception):
    """What stands in the way of an installation and the way out, in one line."""


def main(extra: str) -> None:
    """Leaves a whole ``.venv``. One that is whole already is left as it is, without a word.

    A machine that cannot draw is told so each time: tasks that must draw refer to this line.
    """
    require_writable()
    # Of two commands at once one installs, and the other one waits for it here.
    folder = os.open(ROOT, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        complete(extra)
    finally:
        os.close(folder)
    tell_of_lack()


def complete(extra: str) -> None:
    """Makes ``.venv``, or adds what it lacks."""
    wanted, (own, _) = os.environ.get("PYTHON", ""), probe(OWN_PYTHON)
    is_own = bool(own) and (not wanted or probe(wanted)[0] == own)
    if is_own and is_ready(extra):
        return

    require_platform()
    start_s = time.monotonic()
    if is_own and STAMP.is_file():
        say("pyproject.toml has changed or the tests need more: .venv gets what it lacks")
    else:
        make_venv(*interpreter(wanted))
    if STAMP.is_file():
        STAMP.unlink()
    install(extra)
    STAMP.write_text(stamp_of(extra))

    minutes = (time.monotonic() - start_s) / 60
    say(f".venv is ready, after {minutes:.1f} minutes")


def run(command: "list[str]") -> "subprocess.CompletedProcess[str]":
    """Runs a command, all of whose output is kept; under an old Python too."""
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.run(command, universal_newlines=True, check=False, **output)


def say(line: str) -> None:
    print(f"setup: {line}", flush=True)


# --------------------------------------------------------------------------- what there is


def stamp_of(extra: str) -> str:
    """Returns what is written into a ``.venv`` that has all packages listed today, and an extra."""
    listed = b"".join((ROOT / name).read_bytes() for name in ("pyproject.toml", "constraints.txt"))
    return f"{hashlib.sha256(listed).hexdigest()} {extra}\n"


def is_ready(extra: str) -> bool:
    """Tells whether ``.venv`` has all packages listed today, and the extra."""
    return STAMP.is_file() and STAMP.read_text() in (stamp_of(extra), stamp_of("dev"))


def probe(python: object) -> "tuple[str, bool]":
    """Returns the version of an interpreter, empty where it cannot be run, and whether it has the
    modules that make a virtual environment."""
    try:
        done = run([str(python), "-c", PROBE])
    except OSError:
        return "", False
    answer = re.match(r"(\d+\.\d+\.\d+)\n(with venv)?", done.stdout)
    return (answer.group(1), bool(answer.group(2))) if answer else ("", False)


def interpreter(wanted: str) -> "tuple[str, str]":
    """Returns the Python for ``.venv`` and its version. Raises `Refusal` where there is none."""
    found = {}
    for name in (wanted,) if wanted else (*NAMES, getattr(sys, "_base_executable", sys.executable)):
        found[name], has_venv = probe(name)
        if found[name].startswith(SUPPORTED) and has_venv:
            return name, found[name]

    for name, version in found.items():
        if version.startswith(SUPPORTED):
            package = f"python{version.rpartition('.')[0]}-venv"
            raise Refusal(
                f"{name} (Python {version}) has no module venv; install it (the package {package} "
                "on Debian and Ubuntu), or install uv"
            )
    if wanted:
        what = f"is Python {found[wanted]}" if found[wanted] else "cannot be run"
        raise Refusal(
            f"PYTHON={wanted} {what}, and SkyShield needs Python 3.10 to 3.13; name one of these, "
            "or leave PYTHON out and one is looked for"
        )
    others = sorted({version for version in found.values() if version})
    raise Refusal(
        f"no Python 3.10 to 3.13 is on the PATH, only {', '.join(others)}; install one with its "
        "module venv, or uv, or name one: make setup PYTHON=/path/to/python3.11"
    )


# --------------------------------------------------------------------------- what is refused


def require_writable() -> None:
    """Refuses a checkout in which nothing can be made."""
    if not os.access(ROOT, os.W_OK):
        raise Refusal(f"{ROOT} cannot be written to; clone the repository to a folder that can")


def require_platform() -> None:
    """Refuses a machine for which PyTorch has no wheels, or whose system is another one."""
    system, machine = platform.system(), platform.machine()
    if system != "Linux" or machine not in MACHINES:
        raise Refusal(
            f"this is {system} on {machine}, and SkyShield wants Linux on {' or '.join(MACHINES)}; "
            "take such a machine, or a container with Linux"
        )
    libc, version = platform.libc_ver()
    if libc != "glibc" or tuple(map(int, version.split(".")[:2])) < (2, 28):
        raise Refusal(
            f"the system's C library is {libc or 'not glibc'} {version}, and PyTorch's wheels need "
            "glibc 2.28 or later; take a newer distribution, or one that has glibc"
        )


def tell_of_lack() -> None:
    """Says what works and what does not where ``.venv`` lacks a package that draws the data."""
    machine = platform.machine()
    if machine == "x86_64":
        return
    # Somebody may have built them here.
    lacking = run([str(OWN_PYTHON), "-c", LOOK_FOR, *RENDERERS]).stdout.split()
    if lacking:
        say(
            f"{' and '.join(lacking)}, which draw data, have no wheels for {machine}: "
            "task=generate, look, fly and annotate do not work here, nor fit without a finished "
            "dataset; streams, task=watch, predict, score, test and export do, and fit with "
            "paths.dataset=DIR"
        )


def require_room() -> None:
    free_gb = shutil.disk_usage(ROOT).free / 1e9
    if free_gb < FREE_GB:
        raise Refusal(
            f"{ROOT}: {free_gb:.1f} GB are free on this disk, and .venv takes 2 GB, or 6 GB with "
            f"CUDA; free some space, {GO_ON}"
        )


# --------------------------------------------------------------------------- what is done


def make_venv(python: str, version: str) -> None:
    """Makes a new ``.venv``; what is there is of another Python, or was not finished."""
    require_room()
    again = " again, as the one there is not whole or of another Python" if VENV.exists() else ""
    say(f"making .venv{again}, of {python} (Python {version}; PYTHON=... takes another one)")
    make = [python, "-m", "venv", "--clear", str(VENV)]
    done = run(make)
    if done.returncode != 0:
        raise Refusal(cause_of(done.stdout))


def install(extra: str) -> None:
    """Installs what pyproject.toml lists, with pip's own progress.

    pip keeps what it has downloaded, so that an interrupted installation goes on.
    """
    say(
        f"installing {'110' if extra else '70'} packages: 0.6 GB to download, or 3 GB where the "
        "index has PyTorch with CUDA; two minutes or more, the last one without a word"
    )
    command = [str(OWN_PYTHON), "-m", "pip", "install", "--no-input", "--disable-pip-version-check"]
    what = ["--constraint", "constraints.txt", "--editable", f".[{extra}]" if extra else "."]
    # A variable or a configuration file may ask for an installation elsewhere, which fails here.
    environment = {**os.environ, "PIP_USER": "0", "PIP_REQUIRE_VIRTUALENV": "0"}
    pip = subprocess.Popen(
        [*command, *what],
        cwd=ROOT,
        env=environment,
        stderr=subprocess.PIPE,
        universal_newlines=True,
    )

    told = []
    for line in pip.stderr:
        told.append(line)
        if "Retrying" in line:
            say("the package index does not answer; pip tries again")
    if pip.wait() != 0:
        raise Refusal(cause_of("".join(told)))


def cause_of(told: str) -> str:
    """Returns in one line what pip failed at and the way out, from all that it told."""
    index, proxy = given(INDEXES + PROXIES), given(PROXIES)
    lacking = re.search(r"No matching distribution found for ([^\s;<>=]+)", told)
    causes = (
        ("No space left|Errno 28|Disk quota", "the disk is full; free some space"),
        ("Read-only file system|Errno 30", f"{ROOT} is read-only; clone to another folder"),
        ("Permission denied|Errno 13", f"no permission in {ROOT} or in pip's cache; give it"),
        ("ProxyError", f"the proxy does not answer; check its address{proxy}"),
        ("CERTIFICATE_VERIFY", f"the index has an unknown certificate; see PIP_CERT{index}"),
        (
            "Retrying|ConnectionError",
            f"the package index does not answer; check the network{index}",
        ),
        ("No matching distribution", f"the index has no {lacking and lacking[1]}; check it{index}"),
    )

    for pattern, cause in causes:
        if re.search(pattern, told):
            return f"{cause}, {GO_ON}"
    print(told, file=sys.stderr)
    return f"pip failed, as told above; mend that{index}, {GO_ON}"


def given(names: "tuple[str, ...]") -> str:
    """Names those of some variables that are set, without passwords in their addresses."""
    values = {name: os.environ[name] for name in names if os.environ.get(name)}
    shown = [f"{name}={re.sub('//[^/@]*@', '//***@', value)}" for name, value in values.items()]
    return f" ({', '.join(shown)})" if shown else ""


if __name__ == "__main__":
    try:
        main("dev" if "dev" in sys.argv[1:] else "")
    except Refusal as refusal:
        sys.exit(f"error: {refusal}")
    except KeyboardInterrupt:
        sys.exit("error: interrupted; the same command goes on")
    except OSError as error:
        sys.exit(f"error: {error.filename or VENV}: {error.strerror}; mend that, {GO_ON}")
