"""Each cell of the sheet is the frame that it says."""

import dataclasses

import numpy as np
import pytest
from PIL import Image

from src.data.clip import Clip
from studies.card.contact_sheet import (
    CELL_WIDTH_PIX,
    GAP_PIX,
    HEADER_PIX,
    LABEL_PIX,
    draw_contact_sheet,
)
from studies.card.statistics import statistics_of_clips
from tests.synthetic import write_clip

IDS = ["downtown/clip00", "suburb/clip00", "suburb/clip01"]


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    """Root, and the sheet of downtown in fog and of suburb in rain, which was flown twice."""
    root = tmp_path_factory.mktemp("sheet")
    for seed, clip_id in enumerate(IDS):
        write_clip(root / clip_id, seed=seed)
    statistics = statistics_of_clips(root, IDS)
    clips = statistics.clips.assign(weather=["fog", "rain", "rain"])
    statistics = dataclasses.replace(statistics, clips=clips)
    draw_contact_sheet(root, statistics, root / "sheet.jpg")
    return root, np.asarray(Image.open(root / "sheet.jpg")).astype(float)


def cell(picture, row, column):
    height = CELL_WIDTH_PIX * 64 // 96
    top, left = HEADER_PIX + row * (height + GAP_PIX), LABEL_PIX + GAP_PIX
    left += column * (CELL_WIDTH_PIX + GAP_PIX)
    return picture[top : top + height, left : left + CELL_WIDTH_PIX]


@pytest.mark.parametrize(("row", "column", "clip_id"), [(0, 0, IDS[0]), (1, 1, IDS[1])])
def test_a_cell_is_the_middle_frame_of_the_first_clip(sheet, row, column, clip_id):
    root, picture = sheet
    clip = Clip(root / clip_id)
    shown = cell(picture, row, column)

    def difference(frame):
        image = Image.fromarray(clip.image(frame)).resize(shown.shape[1::-1])
        return np.abs(np.asarray(image).astype(float) - shown).mean()

    assert difference(15) < 2
    assert min(range(30), key=difference) == 15


def test_what_was_never_flown_is_blank(sheet):
    _, picture = sheet
    for row, column in ((0, 1), (1, 0)):
        assert cell(picture, row, column)[4:-4, 4:-4].min() > 250


def test_towns_and_weathers_are_labelled(sheet):
    _, picture = sheet
    header = picture[:HEADER_PIX, LABEL_PIX:]
    for half in (header[:, :CELL_WIDTH_PIX], header[:, CELL_WIDTH_PIX + GAP_PIX :]):
        assert half.min() < 100
    assert picture[HEADER_PIX:, :LABEL_PIX].min() < 100
