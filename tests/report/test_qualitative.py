"""The sheet: which frames it takes, what it hides, and how heavy it may be."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import CAR, FREE, UNKNOWN
from src.report.canvas import MAX_BYTES, write_picture
from src.report.qualitative import pick_frames, qualitative_sheet
from src.report.scene import VoxelScene
from tests.report.street import street, tilted_frustum

GRID = VoxelGrid(shape=(25, 25, 15))


@pytest.fixture(name="scene")
def _scene():
    frustum = tilted_frustum(0.2, 0.1)
    image = np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)
    truth = street(GRID, frustum)
    title = "downtown-03 frame 41 · roll +12°"
    return VoxelScene(title, GRID, image, truth, {"Prediction": street(GRID)}, frustum)


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


def predicting(scene, **predictions):
    return dataclasses.replace(scene, predictions=predictions)


def drawn(path, *args, **kwargs):
    """Pixels of a sheet."""
    qualitative_sheet(*args[:1], path, "SkyOcc", *args[1:], **kwargs)
    with Image.open(path) as sheet:
        return np.asarray(sheet)


def test_the_prediction_is_hidden_where_nothing_is_supervised(tmp_path, scene):
    same, unknown = scene.predictions["Prediction"], scene.truth == UNKNOWN
    junk, other = np.where(unknown, CAR, same), np.where(unknown, same, CAR)
    sheets = {}
    for name, labels in {"same": same, "junk": junk, "other": other}.items():
        row = predicting(scene, Prediction=labels.astype(np.uint8))
        sheets[name] = drawn(tmp_path / "sheet.png", [row])
    assert (sheets["same"] == sheets["junk"]).all()
    assert (sheets["same"] != sheets["other"]).any()


def test_the_sheet_is_a_png_with_a_row_a_scene_and_no_temporary_file_stays(tmp_path, scene):
    heights = []
    for count in (1, 2):
        path = tmp_path / "figures" / f"{count}.png"
        qualitative_sheet([scene] * count, path, "SkyOcc")
        with Image.open(path) as sheet:
            assert sheet.format == "PNG"
            heights.append(sheet.height)
    assert heights[1] - heights[0] > 300
    assert {entry.name for entry in (tmp_path / "figures").iterdir()} == {"1.png", "2.png"}


WIDTH, GAP, IMAGE_WIDTH = 550, 18, 528


def view_in(body, n):
    """The n-th picture in 3-D of a sheet's first row."""
    left = IMAGE_WIDTH + n * WIDTH + (n + 2) * GAP
    return body[:, left : left + WIDTH]


def test_ground_truth_and_prediction_stand_side_by_side(tmp_path, scene):
    pixels = drawn(tmp_path / "sheet.png", [predicting(scene, Prediction=scene.truth)])
    truth, prediction = (view_in(pixels[170:590], n) for n in range(2))
    assert (truth == prediction).all()
    assert np.ptp(truth, axis=-1).max() > 60, "colored voxels"


def test_models_stand_side_by_side_in_their_order_without_a_view_from_above(tmp_path, scene):
    empty = np.full_like(scene.truth, FREE)
    rows = [predicting(scene, baseline=empty, skyocc=scene.truth)]
    pixels = drawn(tmp_path / "sheet.png", rows, tops=False)
    truth, baseline, skyocc = (view_in(pixels[170:590], n) for n in range(3))
    assert (truth == skyocc).all()
    assert (truth != baseline).any()
    assert pixels.shape[1] == IMAGE_WIDTH + 3 * WIDTH + 5 * GAP


def test_rows_of_different_models_are_refused(tmp_path, scene):
    other = predicting(scene, baseline=scene.truth)
    with pytest.raises(UserError, match=r"sheet\.png: .*models"):
        qualitative_sheet([scene, other], tmp_path / "sheet.png", "SkyOcc")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_heavy_picture_keeps_to_its_bytes(tmp_path, suffix):
    noise = np.random.default_rng(0).integers(0, 256, (1200, 900, 3), dtype=np.uint8)
    path = tmp_path / f"sheet{suffix}"
    write_picture(Image.fromarray(noise), path)
    assert path.stat().st_size <= MAX_BYTES[suffix]
    with Image.open(path) as sheet:
        assert 0.7 < sheet.width / sheet.height < 0.8


def test_no_frames_is_one_line(tmp_path):
    with pytest.raises(UserError, match=r"sheet\.png"):
        qualitative_sheet([], tmp_path / "sheet.png", "SkyOcc")
