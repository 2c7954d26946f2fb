"""One flight as a looping picture: what the camera sees, the labels of the space ahead, and what a
model predicts there."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import pandas as pd
from PIL import Image

from ..atomic import replacing
from ..data.actors import visible_actors
from ..data.clip import Clip
from ..data.predictions import Predictions, Sample
from .canvas import Canvas, resized, within_bytes
from .picture import encoded
from .scene import VoxelScene
from .view import Frustum, Viewpoint
from .voxels import view_of

SECONDS, FRAME_HZ = 4.0, 5.0
IMAGE_PIX, VOXEL_PIX, GAP_PIX, TITLE_PIX = 264, (360, 288), 8, 28
MAX_BYTES = 1_000_000


def draw_predicted_flight(
    clips: Mapping[str, Clip], samples: Sequence[Sample], predictions: Predictions, path: str | Path
) -> None:
    """Writes the GIF of `draw_clip` with the predictions beside the labels.

    ``samples`` are the predicted frames of the clips. Shows the clip that has most of them, of
    several the `liveliest`, at most 4 s around the middle of its predicted frames. A prediction is
    hidden where the labels are unknown. Raises `UserError` for a clip or a prediction that cannot
    be read, and a path that cannot be written.
    """
    frames = pd.DataFrame(samples, columns=["clip", "frame"]).groupby("clip", sort=False)["frame"]
    # Of a clip that is held out every frame is predicted, of another only one part: the end.
    counts = frames.count()
    longest = counts.index[counts == counts.max()]
    actors = pd.concat([visible_actors(clips[name]).assign(clip=name) for name in longest])

    shown = liveliest(actors)
    draw_clip(clips[shown], frames.get_group(shown).tolist(), predictions, path)


def liveliest(frames: pd.DataFrame) -> str:
    """Returns the clip in whose image most actors are visible in a frame, of equal ones the first.

    ``frames`` has a row a frame: ``clip``, and the visible actors by type, ``visible/<type>``.
    """
    visible = frames.filter(like="visible/").sum(axis=1)
    return visible.groupby(frames["clip"], sort=False).mean().idxmax()


def draw_clip(
    clip: Clip, frames: Sequence[int], predictions: Predictions | None, path: str | Path
) -> None:
    """Writes a GIF of at most 1 MB, in real time: the image, the labels in 3-D, and predictions
    beside them if given; of some consecutive frames 4 s around their middle."""
    stride = max(1, round(clip.meta.capture_hz / FRAME_HZ))
    length = stride * round(SECONDS * clip.meta.capture_hz / stride)
    first = max(0, (len(frames) - length) // 2)
    shown = frames[first : first + length : stride]
    scenes = [_scene(clip, frame, predictions) for frame in shown]
    draw_scenes(scenes, [round(1000 * stride / clip.meta.capture_hz)] * len(scenes), path)


def draw_scenes(
    scenes: Sequence[VoxelScene],
    durations_ms: Sequence[int],
    path: str | Path,
    titles: Sequence[str] | None = None,
    max_bytes: int | None = None,
) -> None:
    """Writes a GIF of at most some bytes, 1 MB by default: of each frame the image and the volumes,
    for so long. The ``titles`` are those of the images."""
    # One point of view for all frames and volumes, so that nothing moves but the flight.
    labels = [volume for scene in scenes for volume in scene.known().values()]
    view = view_of(labels, scenes[0].grid, VOXEL_PIX)
    titles = titles or ["Front camera"] * len(scenes)
    pictures = [_page(scene, title, view) for scene, title in zip(scenes, titles)]
    encoded = within_bytes(
        pictures, partial(_gif, durations_ms=durations_ms), max_bytes or MAX_BYTES
    )

    with replacing(path) as temporary:
        temporary.write_bytes(encoded)


def _scene(clip: Clip, frame: int, predictions: Predictions | None) -> VoxelScene:
    predicted = {}
    if predictions:
        predicted["Prediction"] = predictions.labels(clip.clip_id, frame).numpy()

    return VoxelScene(
        title=f"{clip.clip_id} frame {frame}",
        grid=clip.meta.grid,
        image=clip.image(frame),
        truth=clip.semantics(frame),
        predictions=predicted,
        frustum=Frustum.of(clip, frame),
    )


def _page(scene: VoxelScene, title: str, view: Viewpoint) -> Image.Image:
    """Draws the image and the volumes of a frame side by side, with a title over each and the
    colors of the classes below the image."""
    image = resized(scene.image, width_pix=IMAGE_PIX)
    pictures = {title: image, **scene.drawn(VOXEL_PIX, view)}
    widths = [picture.shape[1] + GAP_PIX for picture in pictures.values()]
    page, left = Canvas(sum(widths) - GAP_PIX, TITLE_PIX + VOXEL_PIX[1]), 0

    for (title, picture), width in zip(pictures.items(), widths):
        page.picture(picture, left, TITLE_PIX)
        page.text(left + picture.shape[1] / 2, TITLE_PIX / 2, title, size=12, ha="center")
        left += width

    below = (TITLE_PIX + image.shape[0] + page.height_pix) / 2
    page.legend(below, u=IMAGE_PIX / 2, columns=2, size=10, skip=["free"])
    return page.drawn()


def _gif(pictures: list[Image.Image], durations_ms: Sequence[int]) -> bytes:
    # Median cut would give the few voxels of a rare class their neighbours' color.
    first, *others = (p.quantize(256, Image.Quantize.FASTOCTREE) for p in pictures)
    settings = {"duration": list(durations_ms), "loop": 0, "optimize": False}
    return encoded(first, "GIF", save_all=True, append_images=others, **settings)
