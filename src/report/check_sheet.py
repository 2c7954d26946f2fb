"""Labels laid over the images that they belong to: for the eye that trusts no number."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ..data.clip import Clip
from .canvas import MUTED, Canvas, resized, write_jpeg
from .labels_in_image import labels_in_image
from .qualitative import add_legend
from .view import Frustum

FRAMES = 6
COLUMNS = 2
CELL_WIDTH_PIX, GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 420, 8, 30, 56, 56
JPEG_QUALITY = 88


def draw_check_sheet(root: Path, clip_ids: list[str], path: str | Path, heading: str) -> None:
    """Write a JPEG of frames of some clips: the image, and the image under its own labels.

    Shows the most tilted frame of each of six clips, evenly spaced among those given; of fewer
    clips, more frames each. A wrong attitude, mount or grid shows as colors beside their objects.
    Raises `UserError` for a clip that cannot be read and a path that cannot be written.
    """
    picked = [(Clip(root / clip_ids[n]), frame) for n, frame in _picked(root, clip_ids)]
    pairs = [(clip.image(frame), overlaid(clip, frame)) for clip, frame in picked]
    titles = [_title(clip, frame) for clip, frame in picked]
    write_jpeg(_page(pairs, titles, heading).drawn(), path, JPEG_QUALITY)


def overlaid(clip: Clip, frame: int) -> UInt8[np.ndarray, "h w 3"]:
    """A frame's image under its labels, by the chain that the model projects with."""
    labels, camera = clip.semantics(frame), Frustum.of(clip, frame)
    return labels_in_image(clip.image(frame), labels, clip.meta.grid, camera)


def _picked(root: Path, clip_ids: list[str]) -> list[tuple[int, int]]:
    """Clips by index, each with its most tilted frames."""
    count = min(FRAMES, len(clip_ids))
    # Evenly spaced, so that a long list shows several towns.
    clips = np.unique(np.linspace(0, len(clip_ids) - 1, count).round().astype(int)).tolist()
    shares = [FRAMES // len(clips) + (n < FRAMES % len(clips)) for n in range(len(clips))]
    picked = []
    for clip, share in zip(clips, shares):
        frames = Clip(root / clip_ids[clip]).frames
        tilt_rad = (frames["roll_rad"].abs() + frames["pitch_rad"].abs()).to_numpy()
        # The most tilted of as many equal parts of the clip as there are frames to show.
        parts = np.array_split(np.arange(len(tilt_rad)), share)
        picked += [(clip, int(part[tilt_rad[part].argmax()])) for part in parts]
    return picked


def _title(clip: Clip, frame: int) -> str:
    row = clip.frames.iloc[frame]
    roll_deg, pitch_deg = np.degrees([row["roll_rad"], row["pitch_rad"]])
    return (
        f"{clip.folder.name} frame {frame} · {clip.meta.weather.replace('_', ' ')} · "
        f"roll {roll_deg:+.0f}° pitch {pitch_deg:+.0f}°"
    )


def _page(pairs: list[tuple[np.ndarray, np.ndarray]], titles: list[str], heading: str) -> Canvas:
    height_pix, width_pix = pairs[0][0].shape[:2]
    cell_pix = (CELL_WIDTH_PIX, round(CELL_WIDTH_PIX * height_pix / width_pix))
    pair_pix = 2 * cell_pix[0] + 3 * GAP_PIX
    row_pix = cell_pix[1] + TITLE_PIX
    rows = -(-len(pairs) // COLUMNS)
    page = Canvas(COLUMNS * pair_pix, HEADER_PIX + rows * row_pix + FOOTER_PIX)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=19)

    for n, (pair, title) in enumerate(zip(pairs, titles)):
        row, column = divmod(n, COLUMNS)
        left, top = GAP_PIX + column * pair_pix, HEADER_PIX + row * row_pix
        page.text(left, top + TITLE_PIX / 2, title, size=13, color=MUTED)
        for side, picture in enumerate(pair):
            u = left + side * (cell_pix[0] + GAP_PIX)
            page.picture(resized(picture, *cell_pix), u, top + TITLE_PIX)
    add_legend(page.figure, FOOTER_PIX / 2 / page.height_pix, skip=("free",))

    return page
