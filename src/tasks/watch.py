"""task=watch: what trained weights see in a video of one's own, given the UAV's poses."""

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from omegaconf import DictConfig
from torch import Tensor

from .. import geometry
from ..atomic import replacing_folder
from ..data.flight_log import FlightLog
from ..data.footage import Pictures, Video, footage_of
from ..data.predictions import FACTS, PredictedFrame, save_predictions
from ..errors import UserError
from ..lens import Lens, undistorted
from ..limits import require_finite
from ..models.checkpoint import Checkpoint
from ..models.frame import StreamFrame
from ..models.ground import require_height
from ..models.stream import HIGHEST_M, TOO_HIGH, SkyOccStream
from ..ontology import UNKNOWN
from ..report.scene import VoxelScene
from ..report.view import Frustum
from ..terminal import metered, say, tracked
from .trainer import kind_of_device

PREDICTIONS, FILM, RECORDING = "predictions", "watch.gif", "watch.mcap"
FILM_FRAMES, FILM_BYTES = 75, 4_000_000
# Of the network's view: less than this is not worth a line.
UNSEEN_SHARE = 0.001
# A frame of a history may be so far from its time, if the camera is not slower.
TOLERANCE_S = 0.02
OPENCV_PIX = 0.5
Image = UInt8[Tensor, "3 h w"]


@dataclass(frozen=True)
class Watched:
    """A video and the poses that go with it.

    ``wanted`` are the numbers of the images to look at, and ``times_s`` their times by the poses'
    clock. ``interval_s`` lies between all images, looked at or not.
    """

    name: str
    footage: Video | Pictures
    wanted: list[int]
    times_s: Float[np.ndarray, "t"]
    interval_s: float
    log: FlightLog


def watch(
    cfg: DictConfig,
    out: str,
    camera: Mapping,
    poses_convention: str,
    start_s: float,
    seconds: float | None,
    rate_hz: float | None,
    predict_hz: float,
    speed_mps: float,
) -> None:
    """Predicts the frames of ``video`` with the poses of ``poses``, and writes labels, a film and,
    where foxglove-sdk is installed, an MCAP file, all or nothing.

    Raises `UserError`, before the first prediction, for a video, poses or a camera that cannot be,
    or do not fit each other or the network.
    """
    for key, value in (("rate_hz", rate_hz), ("predict_hz", predict_hz), ("seconds", seconds)):
        if value is not None:
            require_finite(f"task.{key}", value)
    for key in ("video", "poses"):
        if cfg.get(key) is None:
            raise UserError(f"{key}: task=watch needs video=FILE or FOLDER, and poses=FILE.csv")
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)
    log = FlightLog.read(Path(cfg.poses).expanduser(), poses_convention)
    watched = _watched(cfg, log, start_s, seconds, rate_hz, predict_hz)
    lens = _lens(camera, watched.footage.size_pix)
    folder = Path(out) / watched.name
    if folder.exists() and not (folder / PREDICTIONS / FACTS).is_file():
        raise UserError(f"{folder}: exists and is not of task=watch; choose another task.out")

    watcher = _Watcher(cfg, watched, lens, camera, speed_mps)
    watcher.announce()
    with replacing_folder(folder) as new:
        watcher.write(new)
    others = sorted(each.name for each in folder.iterdir() if each.is_file())
    say(f"{folder}: labels of {watcher.done} frames, {', '.join(others)}")


def _watched(
    cfg: DictConfig,
    log: FlightLog,
    start_s: float,
    seconds: float | None,
    rate_hz: float | None,
    predict_hz: float,
) -> Watched:
    """Opens the video, chooses its frames, and finds their poses."""
    path = Path(cfg.video).expanduser().resolve()
    footage = footage_of(path)
    named = log.named_images() if isinstance(footage, Pictures) and not rate_hz else {}
    if named:
        footage.keep([*named])
    if isinstance(footage, Pictures) and not rate_hz and start_s:
        raise UserError(
            "task.start_s: these images have times of their own; give task.rate_hz, too"
        )
    times_s = np.array([*named.values()]) if named else start_s + footage.times_s(rate_hz)
    if (np.diff(times_s) <= 0).any():
        raise UserError(
            f"video: two images of {path} have one time; name each once, or give task.rate_hz"
        )
    if seconds is not None:
        times_s = times_s[times_s < times_s[0] + seconds]
    log.require_span(times_s, path.name)
    if times_s[0] < 0:
        raise UserError(f"video: {path} begins at {times_s[0]:g} s; let time_s begin at 0 or later")

    # The image nearest to each tick, once.
    ticks_s = np.arange(times_s[0], times_s[-1] + 0.5 / predict_hz, 1 / predict_hz)
    nearest = np.interp(ticks_s, times_s, np.arange(len(times_s))).round().astype(int)
    wanted = sorted({*nearest.tolist()})
    steps_s = np.diff(times_s) if len(times_s) > 1 else np.zeros(1)
    return Watched(path.stem, footage, wanted, times_s[wanted], float(np.median(steps_s)), log)


def _lens(camera: Mapping, size_pix: tuple[int, int]) -> Lens:
    """Returns the lens that ``task.camera`` describes, for images of a size."""
    width, height = size_pix
    names = "fx", "fy", "cx", "cy"
    for name in (*names, "hfov_deg"):
        if not isinstance(camera[name], int | float | None):
            raise UserError(f"task.camera.{name}: {camera[name]!r} is no number")
    given = [camera[name] for name in names if camera[name] is not None]
    distortion = tuple(camera["distortion"])
    if not all(isinstance(each, int | float) for each in distortion):
        raise UserError(f"task.camera.distortion: {[*distortion]}; give numbers")
    if camera["hfov_deg"] is not None and not given:
        if not 1 < camera["hfov_deg"] < 179:
            raise UserError(f"task.camera.hfov_deg: {camera['hfov_deg']}; give 1 to 179 degrees")
        matrix = geometry.pinhole(width, height, math.radians(camera["hfov_deg"]))
        return Lens((float(matrix[0, 0]),) * 2, (width / 2, height / 2), distortion)
    if len(given) < 4 or camera["hfov_deg"] is not None:
        raise UserError("task.camera: give hfov_deg, or else all of fx, fy, cx, cy in pixels")

    fx, fy, cx, cy = given
    matrix = torch.tensor([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], dtype=torch.float64)
    geometry.require_middle("task.camera", matrix, size_pix)
    return Lens((fx, fy), (cx + OPENCV_PIX, cy + OPENCV_PIX), distortion)


class PredictedScene(VoxelScene):
    """A frame without labels: ``truth``, which is not shown, marks by 255 what no camera sees."""

    @property
    def volumes(self) -> Mapping[str, np.ndarray]:
        return self.predictions


class _Watcher:
    """Looks at the frames of a video, one by one, with the network of a checkpoint."""

    def __init__(
        self, cfg: DictConfig, watched: Watched, lens: Lens, camera: Mapping, speed_mps: float
    ) -> None:
        checkpoint = Checkpoint.read(cfg.ckpt_path)
        config = checkpoint.origin.config
        image = config["sim"]["image"]
        self.size_pix = image["width"], image["height"]
        self.pix_from_camera = geometry.pinhole(*self.size_pix, math.radians(image["hfov_deg"]))
        pitch_rad = math.radians(camera["pitch_deg"])
        self.body_from_camera = geometry.front_mount([*camera["position_m"]], pitch_rad)
        self.grid = geometry.VoxelGrid(**config["grid"])
        self.watched, self.lens, self.speed_mps = watched, lens, speed_mps
        self.world_from_body = watched.log.poses_at(watched.times_s)
        self.velocity_mps = watched.log.velocities_at(watched.times_s)
        self.facts = {"video": str(watched.footage.path), "checkpoint": str(checkpoint.path)}

        network = checkpoint.network(cfg.calibrated).to(kind_of_device(cfg.trainer.accelerator))
        heights_m = torch.from_numpy(self.world_from_body[:, 2, 3].copy())
        require_height("poses: height_m", heights_m, network.heights_m)
        step_s = config["data"]["history_step_s"]
        # Of a slow camera, the frame nearest to the time of a past one will do.
        tolerance_s = min(max(TOLERANCE_S, watched.interval_s), step_s / 2)
        self.reach_s = step_s + tolerance_s
        self.stream = SkyOccStream(network, step_s, tolerance_s)
        self.shown: dict[float, VoxelScene] = {}
        self.done, self.seen_s = 0, []

    def announce(self) -> None:
        """Prints what is looked at, and what is known and assumed of the motion."""
        times_s, sizes = self.watched.times_s, (self.watched.footage.size_pix, self.size_pix)
        size, seen_at = ("x".join(map(str, each)) for each in sizes)
        say(
            f"{self.watched.footage.path}: {len(times_s)} frames, {times_s[0]:.2f} to "
            f"{times_s[-1]:.2f} s, {size} pixels, resampled to {seen_at}"
        )

        motion = self.watched.log.motion
        if self.velocity_mps is None:
            motion += (
                f", so each image is seen by itself, and the velocity is taken to be "
                f"{self.speed_mps:g} m/s along the yaw (task.speed_mps)"
            )
        elif len(times_s) > 1 and (step_s := float(np.median(np.diff(times_s)))) > self.reach_s:
            motion += f", but images {step_s:g} s apart are too far apart to be seen together"
        say(f"motion: {motion}")

        if high := int((self.world_from_body[:, 2, 3] > HIGHEST_M).sum()):
            say(f"{high} of the frames are {TOO_HIGH}")
            warnings.filterwarnings("ignore", f".*{TOO_HIGH}")

    def write(self, folder: Path) -> None:
        """Fills a folder with labels, film and, where possible, an MCAP file."""
        # Filled frame by frame: a video may end before its header says.
        facts = {**self.facts, "motion": self.watched.log.motion, "times_s": self.seen_s}
        with self._recorder(folder / RECORDING) as recorder:
            save_predictions(folder / PREDICTIONS, facts, self._predicted(recorder))
        self._draw(folder / FILM)

    def _recorder(self, path: Path) -> AbstractContextManager:
        """Returns a writer of MCAP; where its library is not installed, says so."""
        from ..formats.mcap import McapWriter

        camera = self.body_from_camera, self.pix_from_camera, self.size_pix
        try:
            return McapWriter(path, self.grid, *camera)
        except UserError as error:
            say(f"without {path.name}: {str(error).partition(': ')[2]}")
            return nullcontext()

    def _predicted(self, recorder: object | None) -> Iterator[PredictedFrame]:
        """Predicts frame by frame; keeps what the film shows and records all."""
        wanted, times_s = self.watched.wanted, self.watched.times_s
        images = self.watched.footage.images(wanted)
        for n, pixels in enumerate(tracked(images, "predicting", len(wanted))):
            self.seen_s.append(float(times_s[n]))
            image, seen = undistorted(
                pixels.transpose(2, 0, 1), self.lens, self.pix_from_camera, self.size_pix
            )
            if n == 0 and (black := 1 - float(seen.float().mean())) > UNSEEN_SHARE:
                say(
                    f"note: your camera does not see {black:.0%} of the network's view: black there"
                )
            labels = self.stream(self._frame(n, image)).argmax(dim=0).to(torch.uint8).cpu()

            scene = self._scene(n, image, seen, labels)
            if n % math.ceil(len(wanted) / FILM_FRAMES) == 0:
                self.shown[times_s[n]] = scene
            if recorder is not None:
                known = {"prediction": scene.truth}
                recorder.add(times_s[n], self.world_from_body[n], known, scene.image)
            self.done += 1
            yield PredictedFrame(self.watched.name, n, labels)

    def _frame(self, n: int, image: Image) -> StreamFrame:
        world_from_body, clip = self.world_from_body[n], self.watched.name
        if self.velocity_mps is not None:
            velocity_mps = self.velocity_mps[n]
        else:
            # Another name for each frame: a stream then has no past, and no parallax.
            yaw_rad, clip = float(geometry.yaw_of(world_from_body)), f"{clip}/{n}"
            velocity_mps = self.speed_mps * np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        camera = self.pix_from_camera, self.body_from_camera
        time_s = float(self.watched.times_s[n])
        return StreamFrame(image, time_s, world_from_body, velocity_mps, *camera, clip)

    def _scene(
        self, n: int, image: Image, seen: Bool[Tensor, "h w"], labels: UInt8[Tensor, "X Y Z"]
    ) -> VoxelScene:
        """Returns a frame to look at: what is outside the images of both cameras is unknown."""
        chain = geometry.camera_from_occ(
            torch.from_numpy(self.world_from_body[n]), self.body_from_camera
        )
        centers = self.grid.centers(torch.float64).flatten(0, 2)
        pix, depth_m = geometry.project(centers, chain, self.pix_from_camera)
        known = geometry.in_image(pix, depth_m, *self.size_pix)
        u, v = pix[known].long().unbind(-1)
        known[known.clone()] = seen[v, u]
        return PredictedScene(
            title=f"{self.watched.times_s[n]:.1f} s",
            grid=self.grid,
            image=image.permute(1, 2, 0).numpy(),
            truth=labels.masked_fill(~known.view(labels.shape), UNKNOWN).numpy(),
            predictions={"Prediction": labels.numpy()},
            frustum=Frustum(chain, self.pix_from_camera, self.size_pix),
        )

    def _draw(self, film: Path) -> None:
        # Loaded for the film alone: drawing code takes seconds to import.
        from ..report.animation import draw_scenes

        scenes, steps_s = [*self.shown.values()], np.diff([*self.shown])
        last_s = steps_s[-1] if len(steps_s) else 1.0
        durations_ms = [round(1000 * step_s) for step_s in (*steps_s, last_s)]
        with metered("drawing the film"):
            draw_scenes(scenes, durations_ms, film, [each.title for each in scenes], FILM_BYTES)
