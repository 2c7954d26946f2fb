"""The sheet: which frames it takes, what it hides, and how heavy it may be."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

from src.errors import UserError
from src.ontology import CAR, FREE, UNKNOWN
from src.report.canvas import GAP_PIX, MAX_BYTES, write_picture
from src.report.qualitative import HEADER_PIX, WIDTHS_PIX, pick_frames, qualitative_sheet
from tests.report.street import SMALL, scene_of


@pytest.mark.parametrize(
    ("tilted", "count", "frames"),
    [
        ({33: 0.4}, 5, [5, 15, 25, 33, 35]),
        ({15: 0.4, 2: 0.3}, 5, [2, 5, 15, 25, 35]),
        ({33: 0.4}, 1, [33]),
        ({}, 40, [*range(40)]),
        ({}, 50, [*range(40)]),
    ],
)
def test_frames_are_the_most_tilted_that_is_left_and_evenly_spaced_others(tilted, count, frames):
    tilt_rad = np.zeros(40)
    tilt_rad[list(tilted)] = list(tilted.values())
    assert pick_frames(tilt_rad, count) == frames


@pytest.fixture(scope="module")
def scene():
    return scene_of(SMALL)


def predicting(scene, **predictions):
    return dataclasses.replace(scene, predictions=predictions)


def drawn(folder, scenes, tops=True):
    """Pixels of a sheet."""
    qualitative_sheet(scenes, folder / "sheet.png", "SkyOcc", tops)
    with Image.open(folder / "sheet.png") as sheet:
        assert sheet.format == "PNG"
        return np.asarray(sheet)


def test_models_stand_side_by_side_in_3d_and_from_above_where_something_is_supervised(
    tmp_path, scene
):
    junk = np.where(scene.truth == UNKNOWN, np.uint8(CAR), scene.truth)
    row = predicting(scene, baseline=np.full_like(junk, FREE), skyocc=junk)
    pixels = drawn(tmp_path, [row])
    image_pix, width_pix, top_pix = WIDTHS_PIX
    *ends, width = np.cumsum([GAP_PIX + w for w in (image_pix, *[width_pix] * 3, *[top_pix] * 3)])
    assert pixels.shape[1] == width + GAP_PIX
    _, *views = np.split(pixels[HEADER_PIX + 60 : HEADER_PIX + 400, GAP_PIX:-GAP_PIX], ends, axis=1)
    for truth, baseline, skyocc in (views[:3], views[3:]):
        pix = min(view.shape[1] for view in (truth, baseline, skyocc)) - GAP_PIX
        assert (truth[:, :pix] == skyocc[:, :pix]).all()
        assert np.ptp(truth, axis=-1).max() > 60, "colored voxels"
        assert (truth[:, :pix] != baseline[:, :pix]).any()


def test_there_is_a_row_a_scene(tmp_path, scene):
    one, two = (drawn(tmp_path, [scene] * count, tops=False) for count in (1, 2))
    assert two.shape[0] - one.shape[0] > 300
    assert two.shape[1] == one.shape[1]


def test_no_frames_and_rows_of_different_models_are_refused(tmp_path, scene):
    for scenes in ([], [scene, predicting(scene, baseline=scene.truth)]):
        with pytest.raises(UserError, match=r"sheet\.png: .*; "):
            drawn(tmp_path, scenes)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_heavy_picture_keeps_to_its_bytes(tmp_path, suffix):
    noise = np.random.default_rng(0).integers(0, 256, (1200, 900, 3), dtype=np.uint8)
    path = tmp_path / f"sheet{suffix}"
    write_picture(Image.fromarray(noise), path)
    assert path.stat().st_size <= MAX_BYTES[suffix]
    with Image.open(path) as sheet:
        assert 0.7 < sheet.width / sheet.height < 0.8
