"""One picture of a dataset: a frame of every town under every weather that it was flown in."""

from pathlib import Path

from src.data.clip import Clip
from src.report.canvas import Canvas, Pixels, readable, resized, write_picture
from studies.card.statistics import Statistics

CELL_WIDTH_PIX, GAP_PIX, LABEL_PIX, HEADER_PIX = 288, 8, 34, 44


def draw_contact_sheet(root: Path, statistics: Statistics, path: str | Path) -> None:
    """Write a JPEG: a row a town, a column a weather, the middle frame of the first such clip.

    A cell is blank where a town was never flown in a weather. Raises `UserError` for an image that
    cannot be read and a path that cannot be written.
    """
    # The first clip of every town and weather stands for all of them.
    clips = statistics.clips.drop_duplicates(["town", "weather"])
    towns, weathers = (list(clips[key].unique()) for key in ("town", "weather"))
    pictures = {
        (towns.index(row.town), weathers.index(row.weather)): _picture(Clip(root / row.clip))
        for row in clips.itertuples()
    }
    cell_height_pix = max(picture.shape[0] for picture in pictures.values())
    width = GAP_PIX + LABEL_PIX + len(weathers) * (CELL_WIDTH_PIX + GAP_PIX)
    height = HEADER_PIX + len(towns) * (cell_height_pix + GAP_PIX)
    page = Canvas(width, height)
    lefts = [LABEL_PIX + GAP_PIX + n * (CELL_WIDTH_PIX + GAP_PIX) for n in range(len(weathers))]
    tops = [HEADER_PIX + n * (cell_height_pix + GAP_PIX) for n in range(len(towns))]
    style = {"size": 17, "ha": "center"}

    for left, weather in zip(lefts, weathers):
        page.text(left + CELL_WIDTH_PIX / 2, HEADER_PIX / 2, readable(weather), **style)
    for top, town in zip(tops, towns):
        v = top + cell_height_pix / 2
        page.text(LABEL_PIX / 2, v, readable(town), rotation=90, **style)

    for (row, column), picture in pictures.items():
        page.picture(picture, lefts[column], tops[row])
    write_picture(page.drawn(), path)


def _picture(clip: Clip) -> Pixels:
    """The frame in the middle of a clip, as wide as a cell."""
    return resized(clip.image(len(clip) // 2), CELL_WIDTH_PIX)
