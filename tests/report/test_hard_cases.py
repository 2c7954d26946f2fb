"""Which frames a comparison shows."""

import pandas as pd

from src.report.hard_cases import RULES, hard_cases


def frames(**columns):
    """Four frames of two clips; what is not given is nowhere."""
    of = {"clip": ["a", "a", "b", "b"], "frame": [3, 4, 3, 4]}
    return pd.DataFrame(of | dict.fromkeys(RULES.values(), [0] * 4) | columns)


def chosen(table, count=6):
    return [tuple(case) for case in hard_cases(table, count)]


def test_each_rule_takes_the_hardest_frame_of_the_clips_left():
    table = frames(tilt_rad=[0.1, 0.4, 0.3, 0.2], thin_structure=[9, 9, 2, 5])
    assert chosen(table) == [("most tilted", "a", 4), ("most thin structure in view", "b", 4)]


def test_of_equally_hard_frames_it_is_the_first():
    assert chosen(frames(vru=[0, 2, 2, 2])) == [("most VRU in view", "a", 4)]


def test_what_is_nowhere_in_sight_chooses_no_frame():
    assert chosen(frames()) == []
    # Cars are only where the most tilted frame is.
    table = frames(tilt_rad=[0.4, 0, 0, 0], car=[1, 1, 0, 0])
    assert chosen(table) == [("most tilted", "a", 3)]


def test_no_more_rules_than_asked_for():
    table = frames(tilt_rad=[0.1, 0.4, 0.3, 0.2], thin_structure=[9, 9, 2, 5])
    assert chosen(table, 1) == [("most tilted", "a", 4)]
    assert chosen(table, 0) == []
