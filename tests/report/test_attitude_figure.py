"""The figure of scores by tilt and under a wrong attitude."""

from itertools import combinations, pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from src.report.attitude import attitude_figure

TILTS_DEG = (0, 5, 10, 15, 20, np.inf)
FRAMES = 12345
"""More than any split has, so that a label is as wide as it can be."""


def table(level):
    """A row for each condition that task=attitude has, in its form."""
    facts = [{"condition": "true"}]
    for low, high in pairwise(TILTS_DEG):
        facts.append(
            {"condition": f"tilt_{low}_{high}deg", "tilt_low_deg": low, "tilt_high_deg": high}
        )
    facts += [{"condition": f"noise_{x}deg", "noise_deg": x} for x in (1, 3, 5)]
    facts += [{"condition": f"delay_{x}s", "delay_s": x} for x in (0.1, 0.2)]
    none = {"tilt_low_deg": 0, "tilt_high_deg": np.inf, "noise_deg": 0, "delay_s": 0}
    scores = {"frames": FRAMES, "value": level, "low": level - 0.02, "high": level + 0.02}
    return pd.DataFrame([{**none, **each, **scores} for each in facts])


@pytest.fixture(scope="module")
def figure():
    levels = {"Baseline": 0.1, "+ Attitude-aware projection": 0.2, "SkyShield": 0.3}
    tables = {name: table(level) for name, level in levels.items()}
    gains = {name: table(level - 0.1) for name, level in levels.items() if level > 0.1}
    figure = attitude_figure(tables, gains, "the baseline")
    FigureCanvasAgg(figure).draw()
    return figure


def test_the_names_of_the_bins_can_be_read(figure):
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert len(boxes) > 2
        for one, other in combinations(boxes, 2):
            assert not one.overlaps(other), axes.get_xlabel()


def test_every_run_has_a_line_and_every_gain_the_colour_of_its_run(figure):
    scores, gains, *faults = (
        {bars.get_label(): bars.lines[0].get_color() for bars in axes.containers}
        for axes in figure.axes
    )
    assert list(scores) == ["Baseline", "+ Attitude-aware projection", "SkyShield"]
    assert faults == [scores, scores]
    assert gains == {name: color for name, color in scores.items() if name != "Baseline"}
