"""Programs as processes of their own: started, watched, and ended with all that they started."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def python(*words: str) -> subprocess.CompletedProcess:
    """A program that has ended well, with what it has printed into a pipe."""
    command = [sys.executable, *words]
    done = subprocess.run(
        command, cwd=ROOT, env=ONE_THREAD, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def start(*words: str) -> subprocess.Popen:
    """A program as the leader of a session, where Ctrl-C means what it means in a terminal."""
    return subprocess.Popen(
        [sys.executable, *words],
        cwd=ROOT,
        env=ONE_THREAD,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def running_in(session: int) -> dict[int, str]:
    """Command lines, by their ids, of the processes of a session that have not ended."""
    running = [path for path, fields in _stats(session) if fields[0] != "Z"]
    return {int(path.name): (path / "cmdline").read_text() for path in running}


def spent_s(session: int) -> float:
    """Processor seconds of a session: of those that run, and of those that these waited for.

    They say how far a program is, however much else the machine does.
    """
    return sum(sum(map(int, fields[11:15])) for _, fields in _stats(session)) / TICKS_A_SECOND


def _stats(session: int) -> Iterator[tuple[Path, list[str]]]:
    """The folder of each process and the fields of its ``stat`` from the state on."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            fields = (path / "stat").read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == session:
                yield path, fields
        except (FileNotFoundError, ProcessLookupError):
            continue
