"""The figure of scores by tilt and under a wrong attitude."""

from itertools import combinations, pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from studies.attitude.figure import COLORS, TOLD, attitude_figure

TILTS_DEG = (0, 2.5, 5, 10, 15, 20, np.inf)
FRAMES = 12345
"""More than any split has, so that a label is as wide as it can be."""


def table(level):
    """A row for each condition that task=attitude has, in its form."""
    facts = [{"condition": "true"}]
    for low, high in pairwise(TILTS_DEG):
        facts.append(
            {"condition": f"tilt_{low}_{high}deg", "tilt_low_deg": low, "tilt_high_deg": high}
        )
    told = facts[: len(TILTS_DEG)]
    facts += [{**each, "condition": f"level_{each['condition']}", "level": True} for each in told]
    facts += [{"condition": f"noise_{x}deg", "noise_deg": x} for x in (1, 3, 5)]
    facts += [{"condition": f"delay_{x}s", "delay_s": x} for x in (0.1, 0.2)]
    none = {
        "tilt_low_deg": 0, "tilt_high_deg": np.inf, "noise_deg": 0, "delay_s": 0, "level": False
    }  # fmt: skip
    scores = {"frames": FRAMES, "value": level, "low": level - 0.02, "high": level + 0.02}
    return pd.DataFrame([{**none, **each, **scores} for each in facts])


@pytest.fixture(scope="module")
def figure():
    levels = {"Baseline": 0.1, "+ Attitude-aware projection": 0.2, "SkyOcc": 0.3}
    tables = {name: table(level) for name, level in levels.items()}
    gains = {name: table(level - 0.1) for name, level in levels.items() if level > 0.1}
    figure = attitude_figure(tables, {"gain": gains, "worth": gains})
    FigureCanvasAgg(figure).draw()
    return figure


def test_the_names_of_the_bins_can_be_read(figure):
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert len(boxes) > 2
        for one, other in combinations(boxes, 2):
            assert not one.overlaps(other), axes.get_xlabel()


def test_every_run_has_a_line_and_every_gain_the_color_of_its_run(figure):
    scores, gains, worths, *faults = (
        {bars.get_label(): bars.lines[0].get_color() for bars in axes.containers}
        for axes in figure.axes
    )
    assert list(scores) == ["Baseline", "+ Attitude-aware projection", "SkyOcc"]
    assert faults == [scores, scores]
    assert gains == {name: color for name, color in scores.items() if name != "Baseline"}
    assert worths == gains


def test_no_two_of_many_runs_look_alike():
    tables = {f"run{n}": table(0.1 + n / 100) for n in range(len(COLORS) + 3)}
    axes, *_ = attitude_figure(tables, {}).axes
    looks = [(bars.lines[0].get_color(), bars.lines[0].get_marker()) for bars in axes.containers]
    assert len(set(looks)) == len(tables)


def test_told_a_level_attitude_each_run_has_a_dashed_line_that_is_named_once(figure):
    first = figure.axes[0]
    dashed = [line for line in first.lines if line.get_linestyle() == "--"]
    assert [line.get_color() for line in dashed] == [
        bars.lines[0].get_color() for bars in first.containers
    ]
    assert all(len(line.get_xdata()) == len(TILTS_DEG) - 1 for line in dashed)
    (legend,) = (legend for part in figure.subfigs for legend in part.legends)
    named = [text.get_text() for text in legend.get_texts()]
    assert named == [*(bars.get_label() for bars in first.containers), TOLD]


def test_of_one_run_there_are_its_scores_alone():
    figure = attitude_figure({"mine": table(0.3)}, {})
    assert len(figure.axes) == 3


def test_without_a_fault_there_is_no_empty_panel():
    rows = table(0.1)
    rows = rows[(rows["noise_deg"] == 0) & (rows["delay_s"] == 0)]
    assert len(attitude_figure({"Baseline": rows}, {}).axes) == 1

    noisy = table(0.1).query("delay_s == 0")
    assert [axes.get_xlabel()[:5] for axes in attitude_figure({"a": noisy}, {}).axes] == [
        "tilt ",
        "noise",
    ]
