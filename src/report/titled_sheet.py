"""Pictures of one size in rows, with a title over each."""

from collections.abc import Sequence

from .canvas import Canvas, Pixels, resized

GAP_PIX, TITLE_PIX = 8, 32


def titled_sheet(
    rows: Sequence[Sequence[tuple[str, Pixels]]],
    cell_width_pix: int,
    header_pix: int = 0,
    footer_pix: int = 0,
) -> Canvas:
    """Places rows of titled pictures on a page, below a header and above a footer that are empty.

    All pictures are scaled to one width; their shapes are taken to be the same.
    """
    cells = [[(title, resized(picture, cell_width_pix)) for title, picture in row] for row in rows]
    row_pix = TITLE_PIX + cells[0][0][1].shape[0]
    width = GAP_PIX + max(map(len, rows)) * (cell_width_pix + GAP_PIX)
    page = Canvas(width, header_pix + len(rows) * row_pix + GAP_PIX + footer_pix)

    for n, row in enumerate(cells):
        for k, (title, picture) in enumerate(row):
            left, top = GAP_PIX + k * (cell_width_pix + GAP_PIX), header_pix + n * row_pix
            page.text(left + 2, top + 0.55 * TITLE_PIX, title, size=13)
            page.picture(picture, left, top + TITLE_PIX)
    return page
