"""The figure of scores by tilt and under a wrong attitude."""

from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from studies.attitude.conditions import condition_table, conditions_of
from studies.attitude.figure import COLORS, TOLD, attitude_figure

FAULTS = [0.5, 1, 3, 5], [0.1, 0.2], True, [0.02, 0.05], [0.01, 0.02]
CONDITIONS = list(conditions_of([2.5, 5, 10, 15, 20], *FAULTS))
FRAMES = 12345
"""More than any split has, so that a label is as wide as it can be."""


def table(level, conditions=CONDITIONS):
    """A row for each condition, in the form that the figure takes."""
    scores = {"frames": FRAMES, "value": level, "low": level - 0.02, "high": level + 0.02}
    return condition_table(conditions, noise_seed=0).assign(**scores)


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
    assert faults == [scores] * 4
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
    assert all(len(line.get_xdata()) == 6 for line in dashed)
    (legend,) = (legend for part in figure.subfigs for legend in part.legends)
    named = [text.get_text() for text in legend.get_texts()]
    assert named == [*(bars.get_label() for bars in first.containers), TOLD]


def test_of_one_run_there_are_its_scores_alone_and_no_panel_is_empty():
    assert len(attitude_figure({"mine": table(0.3)}, {}).axes) == 5
    for noise_deg, names in (([], ["tilt "]), ([1, 3], ["tilt ", "noise"])):
        rows = table(0.1, list(conditions_of([5], noise_deg, [], False)))
        axes = attitude_figure({"Baseline": rows}, {}).axes
        assert [each.get_xlabel()[:5] for each in axes] == names
