"""The animation: which flight, which frames, and how heavy."""

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from src.data.clip import Clip
from src.data.statistics import statistics_of_clips
from src.report import animation
from src.report.animation import GAP_PIX, HEIGHT_PIX, draw_flight, liveliest
from tests.synthetic import write_clip


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("flight")
    write_clip(root / "town/clip00", capture_hz=5)
    return root


def frames_of(path):
    with Image.open(path) as gif:
        pictures = []
        for n in range(gif.n_frames):
            gif.seek(n)
            pictures.append(np.asarray(gif.convert("RGB")).astype(float))
        return pictures, gif.info


def test_it_loops_in_real_time_with_the_image_beside_the_labels(root, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 1.2)
    draw_flight(root, statistics_of_clips(root, ["town/clip00"]), tmp_path / "flight.gif")
    pictures, info = frames_of(tmp_path / "flight.gif")
    assert (len(pictures), info["duration"], info["loop"]) == (6, 200, 0)
    assert (tmp_path / "flight.gif").stat().st_size <= animation.MAX_BYTES
    clip, width_pix = Clip(root / "town/clip00"), round(HEIGHT_PIX * 96 / 64)
    for n, frame in ((0, 27), (3, 30), (5, 32)):
        image = Image.fromarray(clip.image(frame)).resize((width_pix, HEIGHT_PIX))
        left = pictures[n][:, :width_pix]
        assert np.abs(left - np.asarray(image)).mean() < 6
    labels = pictures[0][:, width_pix + GAP_PIX :]
    assert labels.std() > 20
    assert np.abs(labels - pictures[5][:, width_pix + GAP_PIX :]).mean() > 2


def test_a_heavy_one_is_made_smaller(root, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 0.4)
    statistics = statistics_of_clips(root, ["town/clip00"])
    draw_flight(root, statistics, tmp_path / "whole.gif")
    limit = (tmp_path / "whole.gif").stat().st_size // 2
    monkeypatch.setattr(animation, "MAX_BYTES", limit)
    draw_flight(root, statistics, tmp_path / "light.gif")
    assert (tmp_path / "light.gif").stat().st_size <= limit
    assert len(frames_of(tmp_path / "light.gif")[0]) == 2


def test_the_liveliest_flight_of_the_first_weather_is_shown():
    clips = pd.DataFrame({"clip": ["a", "b", "c"], "weather": ["clear", "night", "clear"]})
    frames = pd.DataFrame(
        {
            "clip": ["a", "a", "b", "c"],
            "weather": ["clear", "clear", "night", "clear"],
            "visible/car": [2, 2, 9, 1],
            "visible/bus": [0, 0, 9, 2],
        }
    )
    assert liveliest(clips, frames) == "c"
