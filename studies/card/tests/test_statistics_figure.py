"""The four panels show the numbers of the statistics."""

import numpy as np
import pytest

from src.ontology import ACTOR_TYPES, CLASSES
from src.report.canvas import readable
from studies.card import paper
from studies.card.figure import percent, statistics_figure


@pytest.fixture(scope="module")
def axes(statistics):
    return statistics_figure(statistics).axes


def words(texts):
    return [text.get_text() for text in texts]


def test_a_shows_clips_and_frames_of_town_and_weather(axes):
    assert words(axes[0].get_yticklabels()) == ["suburb"]
    assert words(axes[0].get_xticklabels()) == ["clear", "rain"]
    assert words(axes[0].texts) == ["1\n30", "1\n30"]


def test_b_counts_every_frame_and_marks_mean_and_11_m(axes, statistics):
    assert sum(bar.get_height() for bar in axes[1].patches) == len(statistics.frames)
    marks = [line.get_xdata()[0] for line in axes[1].lines]
    assert marks == [statistics.frames["altitude_m"].mean(), paper.MEAN_HEIGHT_M, 11]


def test_c_is_logarithmic_and_has_every_class(axes, statistics):
    assert axes[2].get_yscale() == "log"
    shares = statistics.class_shares().sort_values("labelled", ascending=False)
    heights = np.array([bar.get_height() for bar in axes[2].patches]).reshape(3, len(CLASSES))
    np.testing.assert_array_equal(heights, shares.to_numpy().T)
    assert words(axes[2].get_xticklabels()) == [readable(name) for name in shares.index]
    diamonds = axes[2].collections[0].get_offsets()
    reported = {shares.index[int(place)]: share for place, share in diamonds}
    assert reported == pytest.approx(paper.CLASS_SHARES)
    assert [percent(share) for share in (0.874521, 0.00016, 0.0)] == ["87.5%", "0.016%", "0%"]


def test_d_sets_our_actors_beside_the_paper_s(axes, statistics):
    heights = np.array([bar.get_height() for bar in axes[3].patches])
    ours, theirs = heights.reshape(2, len(ACTOR_TYPES))
    np.testing.assert_allclose(ours, statistics.visible_per_frame())
    assert theirs[list(ACTOR_TYPES).index("car")] == pytest.approx(2.07, abs=0.005)
    assert words(axes[3].texts)[0] == f"{statistics.frames['visible/car'].sum():,}"
