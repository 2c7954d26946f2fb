"""One picture of a dataset: a frame of every town under every weather that it was flown in."""

from pathlib import Path

from src.data.clip import Clip
from src.report.canvas import GAP_PIX, Canvas, readable, resized, write_picture
from studies.card.statistics import Statistics

CELL_WIDTH_PIX, LABEL_PIX, HEADER_PIX = 288, 34, 44


def draw_contact_sheet(root: Path, statistics: Statistics, path: str | Path) -> None:
    """Write a JPEG: a row a town, a column a weather, the middle frame of the first such clip.

    A cell is blank where a town was never flown in a weather. Raises `UserError` for an image that
    cannot be read and a path that cannot be written.
    """
    # The first clip of every town and weather stands for all of them.
    first = statistics.clips.drop_duplicates(["town", "weather"])
    pictures = {}
    for row in first.itertuples():
        clip = Clip(root / row.clip)
        pictures[row.town, row.weather] = resized(clip.image(len(clip) // 2), CELL_WIDTH_PIX)

    column_pix = CELL_WIDTH_PIX + GAP_PIX
    row_pix = max(picture.shape[0] for picture in pictures.values()) + GAP_PIX
    towns, weathers = (enumerate(first[key].unique()) for key in ("town", "weather"))
    tops = {town: HEADER_PIX + n * row_pix for n, town in towns}
    lefts = {weather: LABEL_PIX + GAP_PIX + n * column_pix for n, weather in weathers}
    page = Canvas(LABEL_PIX + GAP_PIX + len(lefts) * column_pix, HEADER_PIX + len(tops) * row_pix)
    style = {"size": 17, "ha": "center"}
    for weather, left in lefts.items():
        page.text(left + CELL_WIDTH_PIX / 2, HEADER_PIX / 2, readable(weather), **style)
    for town, top in tops.items():
        middle = top + (row_pix - GAP_PIX) / 2
        page.text(LABEL_PIX / 2, middle, readable(town), rotation=90, **style)
    for (town, weather), picture in pictures.items():
        page.picture(picture, lefts[weather], tops[town])
    write_picture(page.drawn(), path)
