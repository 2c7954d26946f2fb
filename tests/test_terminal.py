"""What a command tells of its progress: a bar in a terminal, a line now and then in a file."""

import os
import pty
import re
import subprocess
import sys
import threading

import pytest

from src import terminal
from src.terminal import Meter, duration, metered
from tests.sessions import ROOT


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.4, "0 s"), (89, "89 s"), (90, "1.5 min"), (700, "12 min"), (7200, "2.0 h")],
)
def test_a_time_has_the_unit_that_suits_it(seconds, words):
    assert duration(seconds) == words


@pytest.fixture
def clock(monkeypatch):
    """The time that meters believe in."""
    now = [100.0]
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: now[0])
    return now


def test_the_time_left_follows_from_the_mean_speed(clock):
    meter = Meter("training", total=40)
    assert meter.left_s is None
    meter.advance(10)
    clock[0] += 20
    assert meter.left_s == pytest.approx(60)
    assert str(meter) == "training: 25 % after 20 s, 60 s left"
    meter.done = 41.0  # an estimate of the total may be too low
    assert meter.left_s == 0


def test_a_file_gets_lines_while_the_work_goes_on_even_if_nothing_is_finished(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "LINE_S", 0.01)
    with metered("generating", total=4) as meter:
        meter.advance()
        threading.Event().wait(0.2)
        meter.doing = "generating more"
        threading.Event().wait(0.2)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 4
    assert re.fullmatch(r"generating: (0|25) % after 0 s", lines[0])
    assert lines[-1].startswith("generating more: 25 %")
    threading.Event().wait(0.05)
    assert capsys.readouterr().out == "", "it is silent when the work has ended"


def test_a_row_of_short_works_is_not_silent(monkeypatch, capsys):
    """Each ends before a line is due, and the next one tells it instead."""
    monkeypatch.setattr(terminal, "LINE_S", 0.05)
    for n in range(10):
        with metered(f"scoring {n}"):
            threading.Event().wait(0.03)
    assert 2 <= len(capsys.readouterr().out.splitlines()) <= 6


def test_a_terminal_shows_a_bar_that_is_gone_in_the_end():
    code = (
        "import time; from src.terminal import tracked\n"
        "for _ in tracked(range(4), 'counting'): time.sleep(0.3)\nprint('done')"
    )
    leader, follower = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=follower,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "80"},
    ) as program:
        os.close(follower)
        shown = b""
        while True:
            try:
                shown += os.read(leader, 4096)
            except OSError:
                break
    os.close(leader)
    assert program.returncode == 0
    text = shown.decode()
    assert "counting" in text
    assert "50 %" in text
    # The line of the bar is erased before the next one is printed.
    assert text.rindex("\x1b[2K") > text.rindex("counting")
    assert text.rstrip().endswith("done")
