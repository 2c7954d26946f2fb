"""Labels laid over the images that they belong to: for the eye that trusts no number."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8

from ..data.clip import Clip
from ..geometry import camera_from_occ, inverse, pixel_centres, unproject
from ..ontology import CLASSES, COLORS, FREE
from .canvas import MUTED, Canvas, resized, write_jpeg
from .qualitative import add_legend
from .raycast import VOXEL, cast
from .voxels import SUN

FRAMES = 6
COLUMNS = 2
CELL_WIDTH_PIX, GAP_PIX, TITLE_PIX, HEADER_PIX, FOOTER_PIX = 420, 8, 30, 56, 56
COLOR_SHARE, EDGE_SHARE = 0.6, 0.35
"""How much of a pixel is its voxel's colour, and how much darker the voxel's edges are."""

JPEG_QUALITY = 88
PALETTE = np.array([COLORS[name] for name in CLASSES], dtype=np.float32)


def draw_check_sheet(root: Path, clip_ids: list[str], path: str | Path, heading: str) -> None:
    """Write a JPEG of frames of some clips: the image, and the image under its own labels.

    Shows the most tilted frame of each of six clips, evenly spaced among those given; of fewer
    clips, more frames each. A wrong attitude, mount or grid shows as colours beside their objects.
    Raises `UserError` for a clip that cannot be read and a path that cannot be written.
    """
    picked = [(Clip(root / clip_ids[n]), frame) for n, frame in _picked(root, clip_ids)]
    pairs = [(clip.image(frame), overlaid(clip, frame)) for clip, frame in picked]
    titles = [_title(clip, frame) for clip, frame in picked]
    write_jpeg(_page(pairs, titles, heading).drawn(), path, JPEG_QUALITY)


def overlaid(clip: Clip, frame: int) -> UInt8[np.ndarray, "h w 3"]:
    """A frame's image, every pixel tinted by the first occupied voxel on its ray, edges darker.

    The ray is the one through the pixel's centre, by the chain that the model projects with.
    """
    meta, image = clip.meta, clip.image(frame)
    chain = camera_from_occ(clip.world_from_body[frame], meta.body_from_camera)
    occ_from_camera = inverse(chain)
    pix = pixel_centres(meta.width, meta.height).reshape(-1, 2)
    rays = unproject(pix, torch.ones(len(pix), dtype=torch.float64), meta.pix_from_camera)
    rays_occ = (rays @ occ_from_camera[:3, :3].T).contiguous().numpy()
    origin = (occ_from_camera[:3, 3].numpy() - meta.grid.lower_m) / meta.grid.voxel_m
    labels = clip.semantics(frame)
    hits = cast(labels < FREE, origin, rays_occ, SUN, -np.inf)
    met = hits.kind == VOXEL
    color = PALETTE[labels[tuple(hits.voxel[met].T)]]
    # An edge is a pixel wide, however far away it is.
    pixel = hits.distance[met] / float(meta.pix_from_camera[0, 0])
    color = color * (1 - EDGE_SHARE * (hits.edge[met] < pixel))[:, None]
    tinted = image.reshape(-1, 3).astype(np.float32)
    tinted[met] += COLOR_SHARE * (color - tinted[met])
    return np.rint(tinted).astype(np.uint8).reshape(image.shape)


def _picked(root: Path, clip_ids: list[str]) -> list[tuple[int, int]]:
    """Clips by index, each with its most tilted frames."""
    count = min(FRAMES, len(clip_ids))
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
