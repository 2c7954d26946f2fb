"""Each cell of the sheet is the frame that it says."""

import dataclasses

import numpy as np
from PIL import Image

from src.data.clip import Clip
from src.report.canvas import GAP_PIX
from studies.card.contact_sheet import CELL_WIDTH_PIX, HEADER_PIX, LABEL_PIX, draw_contact_sheet
from studies.card.statistics import statistics_of_clips
from tests.synthetic import write_clip

IDS = ["downtown/clip00", "suburb/clip00", "suburb/clip01"]


def test_a_cell_is_the_middle_frame_of_the_first_clip_or_blank(tmp_path):
    """The sheet of downtown in fog and of suburb in rain, which was flown twice."""
    for seed, clip_id in enumerate(IDS):
        write_clip(tmp_path / clip_id, seed=seed)
    statistics = statistics_of_clips(tmp_path, IDS)
    clips = statistics.clips.assign(weather=["fog", "rain", "rain"])
    statistics = dataclasses.replace(statistics, clips=clips)
    draw_contact_sheet(tmp_path, statistics, tmp_path / "sheet.jpg")
    sheet = np.asarray(Image.open(tmp_path / "sheet.jpg")).astype(float)

    size = CELL_WIDTH_PIX, CELL_WIDTH_PIX * 64 // 96
    rows, columns = np.split(sheet[HEADER_PIX:], [size[1] + GAP_PIX]), []
    for row in rows:
        cells = np.split(row[: size[1], LABEL_PIX + GAP_PIX :], [CELL_WIDTH_PIX + GAP_PIX], axis=1)
        columns.append([cell[:, :CELL_WIDTH_PIX] for cell in cells])
    for clip_id, shown in ((IDS[0], columns[0][0]), (IDS[1], columns[1][1])):
        clip = Clip(tmp_path / clip_id)
        images = [Image.fromarray(clip.image(frame)).resize(size) for frame in range(30)]
        differences = [np.abs(np.asarray(image) - shown).mean() for image in images]
        assert np.argmin(differences) == 15
        assert min(differences) < 2
    for blank in (columns[0][1], columns[1][0]):
        assert blank[4:-4, 4:-4].min() > 250

    # Towns and weathers are labelled.
    for half in np.split(sheet[:HEADER_PIX, LABEL_PIX:], 2, axis=1):
        assert half.min() < 100
    assert all(row[: size[1], :LABEL_PIX].min() < 100 for row in rows)
