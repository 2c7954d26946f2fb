"""The animation: which flight, which frames, what stands side by side, and how heavy."""

import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image, ImageSequence

from src.data.clip import Clip
from src.data.predictions import Predictions, save_predictions
from src.ontology import BUILDING, UNKNOWN
from src.report import animation
from src.report.animation import (
    GAP_PIX,
    IMAGE_PIX,
    TITLE_PIX,
    VOXEL_PIX,
    draw_clip,
    draw_predicted_flight,
)
from tests.synthetic import write_clip

CLIPS = ["town/clip00", "town/clip01", "town/clip02"]

# The front image is 96x64.
SIZE_PIX = IMAGE_PIX, round(IMAGE_PIX * 64 / 96)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("flight")
    for seed, name in enumerate(CLIPS):
        write_clip(root / name, capture_hz=5, seed=seed)
    return root


@pytest.fixture
def predicted(root, tmp_path):
    """Draws predictions of whole clips or of the end of one, and returns the frames."""

    def draw(samples, labels_of):
        clips = {name: Clip(root / name) for name in CLIPS}
        labels = [torch.from_numpy(labels_of(clips[name].semantics(n))) for name, n in samples]
        frames = ((*sample, each, None) for sample, each in zip(samples, labels))
        save_predictions(tmp_path / "mine", {}, frames)

        predictions, path = Predictions(tmp_path / "mine"), tmp_path / "flight.gif"
        draw_predicted_flight(clips, samples, predictions, path)
        return frames_of(path)

    return draw


def frames_of(path):
    with Image.open(path) as gif:
        frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(gif)]
        return [np.asarray(frame).astype(float) for frame in frames], gif.info


def panels_of(picture):
    """The image and the volumes of a frame, without their titles."""
    image, *volumes = np.split(
        picture[TITLE_PIX:], range(IMAGE_PIX, picture.shape[1], VOXEL_PIX[0] + GAP_PIX), axis=1
    )
    return image[: SIZE_PIX[1]], *(volume[:, GAP_PIX:] for volume in volumes)


def shows(picture, clip, frame):
    """Tells whether a picture begins with the image of a frame."""
    image = Image.fromarray(clip.image(frame)).resize(SIZE_PIX)
    return np.abs(panels_of(picture)[0] - np.asarray(image)).mean() < 6


def test_it_loops_in_real_time_with_the_image_beside_the_labels(root, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 1.2)
    clip = Clip(root / CLIPS[0])
    draw_clip(clip, range(len(clip)), None, tmp_path / "flight.gif")
    pictures, info = frames_of(tmp_path / "flight.gif")
    assert (len(pictures), info["duration"], info["loop"]) == (6, 200, 0)
    assert (tmp_path / "flight.gif").stat().st_size <= animation.MAX_BYTES

    assert all(shows(pictures[n], clip, frame) for n, frame in ((0, 27), (3, 30), (5, 32)))
    (_, first), (_, last) = panels_of(pictures[0]), panels_of(pictures[5])
    assert first.std() > 20
    assert np.abs(first - last).mean() > 2
    # Its title stands over the middle of each panel, and is dark.
    dark = pictures[0][:TITLE_PIX].min(axis=(0, 2)) < 100
    middles = (IMAGE_PIX // 2, IMAGE_PIX + GAP_PIX + VOXEL_PIX[0] // 2)
    assert all(dark[middle - 20 : middle + 20].any() for middle in middles)


def test_a_prediction_stands_beside_the_labels_and_is_hidden_where_they_are_unknown(
    predicted, monkeypatch
):
    monkeypatch.setattr(animation, "SECONDS", 0.4)
    samples = [(CLIPS[0], n) for n in range(60)]

    def right_where_known(labels):
        return np.where(labels == UNKNOWN, np.uint8(BUILDING), labels)

    pictures, _ = predicted(samples, right_where_known)
    for picture in pictures:
        _, truth, prediction = panels_of(picture)
        assert truth.std() > 20
        assert np.array_equal(truth, prediction), "same view, same floor, same space"


def test_a_wrong_prediction_is_drawn_as_it_is(predicted, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 0.2)
    samples = [(CLIPS[0], n) for n in range(60)]
    pictures, _ = predicted(samples, lambda labels: np.full_like(labels, BUILDING))
    _, truth, prediction = panels_of(pictures[0])
    assert np.abs(truth - prediction).mean() > 10


def test_a_flight_that_was_predicted_whole_is_shown_and_of_several_the_liveliest(
    root, predicted, monkeypatch
):
    monkeypatch.setattr(animation, "SECONDS", 0.6)
    cars = dict(zip(CLIPS, (9, 1, 2)))

    def visible_actors(clip):
        return pd.DataFrame({"visible/car": [cars[clip.clip_id]] * 60})

    monkeypatch.setattr(animation, "visible_actors", visible_actors)
    samples = [(CLIPS[0], n) for n in range(55, 60)]
    samples += [(name, n) for name in CLIPS[1:] for n in range(60)]
    pictures, _ = predicted(samples, lambda labels: labels)
    assert all(shows(pictures[n], Clip(root / CLIPS[2]), 28 + n) for n in range(3))


def test_the_end_of_a_flight_is_shown_as_far_as_it_was_predicted(root, predicted):
    pictures, _ = predicted([(CLIPS[1], n) for n in range(55, 60)], lambda labels: labels)
    assert len(pictures) == 5
    assert all(shows(pictures[n], Clip(root / CLIPS[1]), 55 + n) for n in range(5))


def test_a_heavy_one_is_made_smaller(root, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "SECONDS", 0.4)
    clip = Clip(root / CLIPS[0])
    draw_clip(clip, range(len(clip)), None, tmp_path / "whole.gif")
    limit = (tmp_path / "whole.gif").stat().st_size // 2
    monkeypatch.setattr(animation, "MAX_BYTES", limit)
    draw_clip(clip, range(len(clip)), None, tmp_path / "light.gif")
    assert (tmp_path / "light.gif").stat().st_size <= limit
    assert len(frames_of(tmp_path / "light.gif")[0]) == 2
