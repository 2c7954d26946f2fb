"""One flight as a looping picture: what the camera sees, the labels of the space ahead, and what a
model predicts there."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from PIL import Image

from ..data.clip import Clip
from ..data.predictions import Predictions
from .canvas import GAP_PIX, TITLE_PIX, encoded, resized, titled_sheet, write_light
from .scene import VoxelScene
from .view import Frustum, PlaceM
from .voxels import view_of

SECONDS, FRAME_HZ = 4.0, 5.0
IMAGE_PIX, VOXEL_PIX = 264, (360, 288)
MAX_BYTES = 1_000_000


def draw_flight(
    clip: Clip,
    path: str | Path,
    frames: Sequence[int] | None = None,
    predictions: Predictions | None = None,
) -> None:
    """Writes a GIF of at most 1 MB: the image, the labels in 3-D and, beside them, predictions if
    given, in real time.

    Shows 4 s around the middle of some consecutive ``frames``, by default of all. A prediction is
    hidden where the labels are unknown. Raises `UserError` for a clip or a prediction that cannot
    be read and a path that cannot be written.
    """
    frames = range(len(clip)) if frames is None else frames
    stride = max(1, round(clip.meta.capture_hz / FRAME_HZ))
    length = stride * round(SECONDS * clip.meta.capture_hz / stride)
    first = max(0, (len(frames) - length) // 2)
    shown = frames[first : first + length : stride]

    scenes = []
    for frame in shown:
        predicted = {}
        if predictions:
            predicted["Prediction"] = predictions.labels(clip.clip_id, frame).numpy()
        title, seen = f"{clip.clip_id} frame {frame}", (clip.image(frame), clip.semantics(frame))
        camera = Frustum.of(clip, frame)
        scenes.append(VoxelScene(title, clip.meta.grid, *seen, predicted, camera))

    draw_scenes(scenes, [round(1000 * stride / clip.meta.capture_hz)] * len(scenes), path)


def draw_scenes(
    scenes: Sequence[VoxelScene],
    durations_ms: Sequence[int],
    path: str | Path,
    titles: Sequence[str] | None = None,
    max_bytes: int | None = None,
    called: Mapping[str, str] | None = None,
) -> None:
    """Writes a GIF of at most some bytes, 1 MB by default: of each frame the image and the volumes,
    for so long. The ``titles`` are those of the images, and ``called`` has the words of the legend
    for classes that mean something else here."""
    # One point of view for all frames and volumes, so that nothing moves but the flight.
    labels = [volume for scene in scenes for volume in scene.known().values()]
    view = view_of(labels, scenes[0].grid, VOXEL_PIX)

    titles = titles or ["Front camera"] * len(scenes)
    pictures = [_page(scene, title, view, called) for scene, title in zip(scenes, titles)]
    write_light(pictures, path, partial(_gif, durations_ms=durations_ms), max_bytes or MAX_BYTES)


def _page(
    scene: VoxelScene, title: str, view: PlaceM, called: Mapping[str, str] | None
) -> Image.Image:
    """Draws the image and the volumes of a frame side by side, with a title over each and the
    colors of the classes below the image."""
    image = resized(scene.image, width_pix=IMAGE_PIX)
    page = titled_sheet([[(title, image), *scene.drawn(VOXEL_PIX, view).items()]])
    below = (TITLE_PIX + image.shape[0] + page.height_pix) / 2
    page.legend(below, u=GAP_PIX + IMAGE_PIX / 2, columns=2, size=10, skip=["free"], called=called)
    return page.drawn()


def _gif(pictures: list[Image.Image], durations_ms: Sequence[int]) -> bytes:
    # Median cut would give the few voxels of a rare class their neighbours' color.
    first, *others = (p.quantize(256, Image.Quantize.FASTOCTREE) for p in pictures)
    settings = {"duration": list(durations_ms), "loop": 0, "optimize": False}
    return encoded(first, "GIF", save_all=True, append_images=others, **settings)
