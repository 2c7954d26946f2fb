"""Labels laid over the images that they belong to: for the eye that trusts no number."""

from collections import Counter
from pathlib import Path

import numpy as np

from ..data.clip import Clip
from .canvas import GAP_PIX, Pixels, beside, readable, resized, titled_sheet, write_picture
from .view import Frustum
from .voxels import labels_in_image

FRAMES = 6
COLUMNS = 2
IMAGE_WIDTH_PIX, HEADER_PIX, FOOTER_PIX = 420, 56, 48


def draw_check_sheet(root: Path, clip_ids: list[str], path: str | Path, heading: str) -> None:
    """Write a JPEG of frames of some clips: the image, and the image under its own labels.

    Shows the most tilted frame of each of six clips, evenly spaced among those given; of fewer
    clips, more frames each. A wrong attitude, mount or grid shows as colors beside their objects.
    Raises `UserError` for a clip that cannot be read and a path that cannot be written.
    """
    # Evenly spaced, so that a long list shows several towns.
    places = np.linspace(0, len(clip_ids) - 1, FRAMES).round().astype(int)
    pairs = []
    for place, share in Counter(places.tolist()).items():
        clip = Clip(root / clip_ids[place])
        tilt_rad = clip.frames[["roll_rad", "pitch_rad"]].abs().sum(axis=1).to_numpy()
        # The most tilted of as many equal parts of the clip as there are frames to show.
        for part in np.array_split(np.arange(len(clip)), share):
            pairs.append(_pair(clip, int(part[tilt_rad[part].argmax()])))

    rows = [pairs[n : n + COLUMNS] for n in range(0, len(pairs), COLUMNS)]
    page = titled_sheet(rows, 2 * IMAGE_WIDTH_PIX + GAP_PIX, HEADER_PIX, FOOTER_PIX)
    page.text(GAP_PIX, HEADER_PIX / 2, heading, size=19)
    page.legend(page.height_pix - FOOTER_PIX / 2, skip=("free",))
    write_picture(page.drawn(), path)


def overlaid(clip: Clip, frame: int) -> Pixels:
    """A frame's image under its labels, by the chain that the model projects with."""
    labels, camera = clip.semantics(frame), Frustum.of(clip, frame)
    return labels_in_image(clip.image(frame), labels, clip.meta.grid, camera)


def _pair(clip: Clip, frame: int) -> tuple[str, Pixels]:
    """A frame's name and attitude, and its image beside the image under its labels."""
    roll_deg, pitch_deg = np.degrees(clip.frames.loc[frame, ["roll_rad", "pitch_rad"]])
    title = (
        f"{clip.folder.name} frame {frame} · {readable(clip.meta.weather)} · "
        f"roll {roll_deg:+.0f}° pitch {pitch_deg:+.0f}°"
    )
    pictures = clip.image(frame), overlaid(clip, frame)
    return title, beside([resized(picture, IMAGE_WIDTH_PIX) for picture in pictures], GAP_PIX)
