"""Labels laid over the images that they belong to: for the eye that trusts no number."""

from pathlib import Path

import numpy as np

from ..data.clip import Clip
from .canvas import Pixels, beside, readable, resized, write_picture
from .labels_in_image import labels_in_image
from .titled_sheet import titled_sheet
from .view import Frustum

FRAMES = 6
COLUMNS = 2
IMAGE_WIDTH_PIX, GAP_PIX, HEADER_PIX, FOOTER_PIX = 420, 8, 56, 48


def draw_check_sheet(root: Path, clip_ids: list[str], path: str | Path, heading: str) -> None:
    """Write a JPEG of frames of some clips: the image, and the image under its own labels.

    Shows the most tilted frame of each of six clips, evenly spaced among those given; of fewer
    clips, more frames each. A wrong attitude, mount or grid shows as colors beside their objects.
    Raises `UserError` for a clip that cannot be read and a path that cannot be written.
    """
    picked = [(Clip(root / clip_ids[n]), frame) for n, frame in _picked(root, clip_ids)]
    pairs = [(_title(clip, frame), _pair(clip, frame)) for clip, frame in picked]
    rows = [pairs[n : n + COLUMNS] for n in range(0, len(pairs), COLUMNS)]
    page = titled_sheet(rows, 2 * IMAGE_WIDTH_PIX + GAP_PIX, HEADER_PIX, FOOTER_PIX)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=19)
    page.legend(page.height_pix - FOOTER_PIX / 2, skip=("free",))
    write_picture(page.drawn(), path)


def _pair(clip: Clip, frame: int) -> Pixels:
    """A frame's image, and beside it the image under its labels."""
    pictures = clip.image(frame), overlaid(clip, frame)
    return beside([resized(picture, IMAGE_WIDTH_PIX) for picture in pictures], GAP_PIX)


def overlaid(clip: Clip, frame: int) -> Pixels:
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
        f"{clip.folder.name} frame {frame} · {readable(clip.meta.weather)} · "
        f"roll {roll_deg:+.0f}° pitch {pitch_deg:+.0f}°"
    )
