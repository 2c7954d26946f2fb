"""The sheet: which frames it takes, what it hides, and how heavy it may be."""

import dataclasses
import io

import numpy as np
import pytest
from PIL import Image

from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import CAR, UNKNOWN
from src.report.qualitative import MAX_BYTES, Example, _encode, pick_frames, qualitative_sheet
from tests.report.street import street, tilted_frustum

GRID = VoxelGrid(shape=(25, 25, 15))


@pytest.fixture(name="example")
def _example():
    frustum = tilted_frustum(0.2, 0.1)
    image = np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)
    truth = street(GRID, frustum)
    return Example(image, truth, street(GRID), "downtown-03 frame 41 · roll +12°", frustum)


def test_frames_are_the_most_tilted_and_evenly_spaced_others():
    tilt_rad = np.zeros(40)
    tilt_rad[33] = 0.4
    assert pick_frames(tilt_rad, 5) == [5, 15, 25, 33, 35]


def test_the_next_most_tilted_frame_is_added_where_the_first_is_there_already():
    tilt_rad = np.zeros(40)
    tilt_rad[[15, 2]] = 0.4, 0.3
    assert pick_frames(tilt_rad, 5) == [2, 5, 15, 25, 35]


@pytest.mark.parametrize(("n_frames", "count"), [(0, 4), (3, 4), (4, 4), (5, 4), (7, 1), (9, 2)])
def test_picked_frames_exist_and_are_distinct(n_frames, count):
    frames = pick_frames(np.linspace(0, 1, n_frames), count)
    assert len(set(frames)) == len(frames) == min(n_frames, count)
    assert set(frames) <= set(range(n_frames))
    assert frames == sorted(frames)


def test_the_prediction_is_hidden_where_nothing_is_supervised(tmp_path, example):
    everywhere = np.where(example.truth == UNKNOWN, np.uint8(CAR), example.prediction)
    differs = np.where(example.truth == UNKNOWN, example.prediction, np.uint8(CAR))
    sheets = {}
    for name, prediction in {
        "same": example.prediction,
        "junk": everywhere,
        "other": differs,
    }.items():
        row = dataclasses.replace(example, prediction=prediction)
        qualitative_sheet([row], GRID, tmp_path / name, "SkyOcc")
        sheets[name] = (tmp_path / name).read_bytes()
    assert sheets["same"] == sheets["junk"]
    assert sheets["same"] != sheets["other"]


def test_the_sheet_is_a_png_with_a_row_an_example_and_no_temporary_file_stays(tmp_path, example):
    heights = []
    for count in (1, 2):
        path = tmp_path / "figures" / f"{count}.png"
        qualitative_sheet([example] * count, GRID, path, "SkyOcc")
        with Image.open(path) as sheet:
            assert sheet.format == "PNG"
            heights.append(sheet.height)
    assert heights[1] - heights[0] > 300
    assert {entry.name for entry in (tmp_path / "figures").iterdir()} == {"1.png", "2.png"}


def test_ground_truth_and_prediction_stand_side_by_side(tmp_path, example):
    path = tmp_path / "sheet.png"
    qualitative_sheet(
        [dataclasses.replace(example, prediction=example.truth)], GRID, path, "SkyOcc"
    )
    with Image.open(path) as sheet:
        pixels = np.asarray(sheet)
    body = pixels[170:590]
    width, gap, image_width = 550, 18, 528
    truth = body[:, 2 * gap + image_width :][:, :width]
    prediction = body[:, 3 * gap + image_width + width :][:, :width]
    assert (truth == prediction).all()
    assert np.ptp(truth, axis=-1).max() > 60, "coloured voxels"


def test_a_heavy_sheet_is_made_smaller():
    noise = np.random.default_rng(0).integers(0, 256, (1200, 900, 3), dtype=np.uint8)
    png = _encode(Image.fromarray(noise))
    assert len(png) <= MAX_BYTES
    with Image.open(io.BytesIO(png)) as sheet:
        assert 0.7 < sheet.width / sheet.height < 0.8


def test_no_frames_or_no_room_to_write_is_one_line(tmp_path, example):
    with pytest.raises(UserError, match=r"sheet\.png: no frames"):
        qualitative_sheet([], GRID, tmp_path / "sheet.png", "SkyOcc")
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        qualitative_sheet([example], GRID, tmp_path / "file" / "sheet.png", "SkyOcc")
