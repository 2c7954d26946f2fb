"""task=export_labels: labels or predictions as Occ3D, SemanticKITTI, OccuFly, PLY or MCAP."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from omegaconf import DictConfig

from ..atomic import replacing_folder
from ..data.predictions import Predictions
from ..data.split import PARTS
from ..data.truth import SkyShieldTruth, truth_at
from ..errors import UserError, closest, import_extra
from ..formats import WRITTEN_FORMATS
from ..formats.layout import write_layout
from ..formats.mcap import McapWriter
from ..formats.ply import write_ply
from ..limits import require_choice
from ..ontology import CLASSES, UNKNOWN
from ..terminal import say, tracked
from .pairing import truth_for

FORMATS = (*WRITTEN_FORMATS, "ply", "mcap")
ALL = "all"


def export_labels(cfg: DictConfig, format: str, part: str, out: str) -> None:
    """Writes the frames of a part (``all``: of every clip) into the folder ``out``.

    They are the labels of ``dataset`` (null: the configured one), or ``predictions`` of it. MCAP
    has both, with images and poses, in a file a clip. Raises `UserError`, before anything is
    written, for an unknown format or part, for an ``out`` that has files, for a folder that is no
    dataset, and for predictions that are missing, damaged or of other frames.
    """
    if format not in FORMATS:
        known = ", ".join(FORMATS)
        raise UserError(f"task.format: {format!r}{closest(str(format), FORMATS)} there are {known}")
    require_choice("task.part", part, (*PARTS, ALL))
    folder = Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"task.out: {out} is there already and not empty; choose another folder")
    if format == "mcap":
        import_extra("foxglove", "view", "task.format: mcap")

    predictions = Predictions(Path(cfg.predictions)) if cfg.predictions else None
    truth = truth_for(cfg, "test" if part == ALL else part, predictions)
    samples = truth.samples
    if part == ALL:
        samples = [(clip, n) for clip, each in truth.clips.items() for n in range(len(each))]
    if predictions and not (inventory := predictions.inventory(samples, truth.grid.shape)).sound:
        raise UserError(f"{predictions.folder}: {inventory}; give the task.part that they are of")

    write = {"mcap": _write_mcap, "ply": _write_ply}.get(format, _write_labels)
    with replacing_folder(folder) as new:
        write(new, Frames(truth, samples, predictions, format))
    say(f"{folder}: {len(samples)} frames as {format}")


@dataclass(frozen=True)
class Frames:
    """What is written: the frames of a dataset, and predictions of them where they are given."""

    truth: SkyShieldTruth
    samples: list[tuple[str, int]]
    predictions: Predictions | None
    format: str

    def tracked(self) -> Iterator[tuple[str, int]]:
        """Yields clip and frame, and shows how many are done."""
        yield from tracked(self.samples, f"writing {self.format}")

    def labels(self, clip: str, frame: int) -> UInt8[np.ndarray, "X Y Z"]:
        """Returns the predicted labels, or the true ones where no predictions are given."""
        if self.predictions:
            return self.predictions.labels(clip, frame).numpy()
        return self.truth.clips[clip].semantics(frame)


def _write_labels(folder: Path, frames: Frames) -> None:
    """Writes a file of labels a frame, masks beside it, and what the files do not say."""
    of, clips = WRITTEN_FORMATS[frames.format], frames.truth.clips
    scenes = {clip: of.scene_of(clip, number) for number, clip in enumerate(clips)}
    ids = np.full(UNKNOWN + 1, of.ids.get("unknown", of.ids["free"]), np.int64)
    ids[: len(CLASSES)] = [of.ids[name] for name in CLASSES]

    velocity_mps = {}
    for clip, frame in frames.tracked():
        scene, token, truth = scenes[clip], f"{frame:06d}", truth_at(clips[clip], frame)
        velocity_mps[f"{scene}/{token}"] = truth["velocity_mps"][0].tolist()
        path = folder / of.place(scene, token, predicted=frames.predictions is not None)
        path.parent.mkdir(parents=True, exist_ok=True)
        known, visible = (truth["semantics"][0] != UNKNOWN).numpy(), truth["visible"][0].numpy()
        of.write(path, ids[frames.labels(clip, frame)], known, visible)

    unseen = [scenes[clip] for clip in sorted(frames.truth.unseen)]
    write_layout(folder, of, frames.truth.grid, velocity_mps, unseen)


def _write_ply(folder: Path, frames: Frames) -> None:
    """Writes ``<clip>/<frame>.ply``."""
    for clip, frame in frames.tracked():
        path = folder / clip / f"{frame:06d}.ply"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_ply(path, frames.truth.grid, frames.labels(clip, frame))


def _write_mcap(folder: Path, frames: Frames) -> None:
    """Writes ``<clip>.mcap``, with the truth also where there are predictions."""
    for name, of_clip in groupby(frames.tracked(), key=itemgetter(0)):
        clip = frames.truth.clips[name]
        meta, times_s = clip.meta, clip.frames["time_s"]
        camera = meta.body_from_camera, meta.pix_from_camera, (meta.width, meta.height)
        with McapWriter(folder / f"{name}.mcap", meta.grid, *camera) as file:
            for _, frame in of_clip:
                labels = {"truth": clip.semantics(frame)}
                if frames.predictions:
                    labels["prediction"] = frames.labels(name, frame)
                pose = clip.world_from_body[frame]
                file.add(float(times_s[frame]), pose, labels, clip.image(frame))
