"""The origin of a number: a digest of plain data, the commit, the machine."""

import hashlib
import json
import os
import platform
import subprocess
from pathlib import Path

SOURCE = Path(__file__).parent


def digest_of(data: object) -> str:
    """Returns twelve hexadecimal digits of the SHA-256 of plain data."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def git_commit() -> str:
    """Returns the commit of the working tree, with ``+`` where it has changes.

    Outside a checkout of this project it is empty, also where it was unpacked inside another
    repository.
    """
    # A checkout of another user, as in a container, is as good as one's own to be named.
    git = ["git", "-c", f"safe.directory={SOURCE.parent}"]
    describe = ["describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]

    def said(*command: str) -> str:
        return subprocess.check_output(
            [*git, *command], cwd=SOURCE, stderr=subprocess.DEVNULL, text=True, timeout=10
        ).strip()

    try:
        is_own = Path(said("rev-parse", "--show-toplevel")).resolve() == SOURCE.parent.resolve()
        return said(*describe) if is_own else ""
    except (OSError, subprocess.SubprocessError):
        return ""


def machine() -> str:
    """Returns the processor's name, the cores that this process may use, and Python's version."""
    file, name = Path("/proc/cpuinfo"), platform.processor() or platform.machine()
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        if line.startswith("model name"):
            name = line.split(":", 1)[1].strip()
    return f"{name}, {len(os.sched_getaffinity(0))} cores, Python {platform.python_version()}"
