"""The animation: which flight, which frames, what stands side by side, and how heavy."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image, ImageSequence

from src.data import actors
from src.data.clip import Clip
from src.data.predictions import PredictedFrame, Predictions, save_predictions
from src.ontology import BUILDING, UNKNOWN
from src.report import animation
from src.report.animation import IMAGE_PIX, VOXEL_PIX, draw_flight
from src.report.canvas import GAP_PIX, TITLE_PIX
from src.tasks.predict import _draw
from tests.synthetic import write_clip

NAMES = ["town/clip00", "town/clip01", "town/clip02"]
# The front image is 96x64.
SIZE_PIX = IMAGE_PIX, round(IMAGE_PIX * 64 / 96)


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    root = tmp_path_factory.mktemp("flight")
    for seed, name in enumerate(NAMES):
        write_clip(root / name, capture_hz=5, seed=seed)
    return {name: Clip(root / name) for name in NAMES}


@pytest.fixture
def predicted(clips, tmp_path):
    """Predicts frames of clips as they are labelled, and a building where nothing is."""

    def predictions(samples):
        labels = [clips[name].semantics(n) for name, n in samples]
        labels = [np.where(each == UNKNOWN, np.uint8(BUILDING), each) for each in labels]
        frames = (
            PredictedFrame(*sample, torch.from_numpy(each)) for sample, each in zip(samples, labels)
        )
        save_predictions(tmp_path / "mine", {}, frames)
        return Predictions(tmp_path / "mine")

    return predictions


def frames_of(path):
    with Image.open(path) as gif:
        frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(gif)]
        return [np.asarray(frame).astype(float) for frame in frames], gif.info


def panels_of(picture):
    """The image and the volumes of a frame, without their titles."""
    image, *volumes = np.split(
        picture[TITLE_PIX:-GAP_PIX, GAP_PIX:],
        range(IMAGE_PIX + GAP_PIX, picture.shape[1] - GAP_PIX, VOXEL_PIX[0] + GAP_PIX),
        axis=1,
    )
    return image[: SIZE_PIX[1], :IMAGE_PIX], *(volume[:, : VOXEL_PIX[0]] for volume in volumes)


def shows(picture, clip, frame):
    """Tells whether a picture begins with the image of a frame."""
    image = Image.fromarray(clip.image(frame)).resize(SIZE_PIX)
    return np.abs(panels_of(picture)[0] - np.asarray(image)).mean() < 6


def test_it_loops_in_real_time_and_a_heavy_one_is_made_smaller(clips, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 1.2)
    clip, path = clips[NAMES[0]], tmp_path / "flight.gif"
    draw_flight(clip, path)
    pictures, info = frames_of(path)
    assert (len(pictures), info["duration"], info["loop"]) == (6, 200, 0)
    assert all(shows(pictures[n], clip, frame) for n, frame in ((0, 27), (3, 30), (5, 32)))
    (_, first), (_, last) = panels_of(pictures[0]), panels_of(pictures[5])
    assert first.std() > 20
    assert np.abs(first - last).mean() > 2
    assert pictures[0][:TITLE_PIX].min() < 100, "titles"

    limit = path.stat().st_size // 2
    monkeypatch.setattr(animation, "MAX_BYTES", limit)
    draw_flight(clip, path)
    assert path.stat().st_size <= limit
    assert len(frames_of(path)[0]) == 6


def test_a_prediction_stands_beside_the_labels_and_is_hidden_where_they_are_unknown(
    clips, predicted, tmp_path
):
    predictions = predicted([(NAMES[0], n) for n in range(55, 60)])
    draw_flight(clips[NAMES[0]], tmp_path / "flight.gif", range(55, 60), predictions)
    pictures, _ = frames_of(tmp_path / "flight.gif")
    assert all(shows(pictures[n], clips[NAMES[0]], 55 + n) for n in range(5))
    _, truth, prediction = panels_of(pictures[0])
    assert truth.std() > 20
    assert np.array_equal(truth, prediction), "same view, floor and space"


def test_a_flight_that_was_predicted_whole_is_shown_and_of_several_the_liveliest(
    clips, predicted, tmp_path, monkeypatch
):
    monkeypatch.setattr(animation, "SECONDS", 0.6)
    cars = {name: pd.DataFrame({"visible/car": [n] * 60}) for name, n in zip(NAMES, (9, 1, 2))}
    monkeypatch.setattr(actors, "visible_actors", lambda clip: cars[clip.clip_id])
    samples = [(NAMES[0], n) for n in range(55, 60)]
    samples += [(name, n) for name in NAMES[1:] for n in range(60)]
    data = SimpleNamespace(clips=clips, split={"test": samples})
    _draw(data, "test", predicted(samples), tmp_path / "flight.gif")
    pictures, _ = frames_of(tmp_path / "flight.gif")
    assert all(shows(pictures[n], clips[NAMES[2]], 28 + n) for n in range(3))
