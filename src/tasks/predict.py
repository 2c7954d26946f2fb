"""task=predict: writes a checkpoint's labels of one part of the split, for task=score or others."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from omegaconf import DictConfig
from torch import Tensor

from ..data.batch import Batch
from ..data.datamodule import SkyShieldData
from ..data.predictions import PredictedFrame, Predictions, save_predictions
from ..data.split import PARTS, held_out_clips
from ..data.truth import truth_of
from ..errors import UserError
from ..knowledge import knowledge as known_of
from ..limits import require_choice
from ..ontology import FREE
from ..terminal import say, tracked
from .model import require_heights
from .session import Session
from .trainer import predictor


def predict(
    cfg: DictConfig, part: str, logits: bool, knowledge: bool = False, animation: str | None = None
) -> None:
    """Writes ``predictions`` (null: ``predictions/<part>`` under the run) and prints where.

    With ``logits`` the class scores lie beside the labels, with ``knowledge`` what the camera sees
    of each voxel, if things are where they are predicted. Clips that are not on the disk any more
    are left out. An ``animation`` is a GIF of one flight of
    the part, with its predictions beside the labels. Raises `UserError` without a checkpoint, for
    one of another model, where no clip is left, where the folder exists, and for an animation that
    is no GIF.
    """
    require_choice("task.part", part, PARTS)
    # Predicting takes long, and would have been done before the picture is drawn.
    if animation is not None and Path(str(animation)).suffix != ".gif":
        raise UserError(f"task.animation: {animation!r}; give a path that ends in .gif, or null")
    session = Session(cfg, allow_missing=True)
    trainer, checkpoint, data = session.trainer, session.checkpoint("predict"), session.data
    if not data.split[part]:
        raise UserError(f"{data.root}: no clip of the {part} frames is there; run task=generate")

    folder = Path(cfg.predictions or session.folder.path / "predictions" / part)
    network = checkpoint.network(cfg.calibrated)
    require_heights(network, data)
    scores_of = predictor(network, trainer)
    facts = {"name": cfg.name, "part": part, "held_out": held_out_clips(data.split)}

    def frames() -> Iterator[PredictedFrame]:
        for batch in tracked(data.in_order(part), f"predicting {part}"):
            scores = scores_of(batch).cpu()
            known = _knowledge(data, batch, scores) if knowledge else [None] * len(scores)
            for n, (clip, frame) in enumerate(zip(batch["clip"], batch["frame"])):
                labels = scores[n].argmax(dim=0).to(torch.uint8)
                kept = scores[n] if logits else None
                yield PredictedFrame(clip, int(frame), labels, kept, known[n])

    # The folder appears under its name when all frames are in it.
    save_predictions(folder, facts | session.facts(network), frames())
    if animation is not None:
        _draw(data, part, Predictions(folder), animation)
        say(animation)
    missing = f"; {len(data.missing)} clips are not there" if data.missing else ""
    say(f"{folder}: {len(data.split[part])} frames{missing}")


def _knowledge(
    data: SkyShieldData, batch: Batch, scores: Float[Tensor, "b 9 X Y Z"]
) -> list[UInt8[np.ndarray, "X Y Z"]]:
    truth = truth_of(batch)
    occupied = (scores.argmax(dim=1) != FREE).numpy()
    cameras = zip(truth["camera_from_occ"], truth["pix_from_camera"])
    size_pix = truth["size_pix"]
    return [known_of(each, *camera, size_pix, data.grid) for each, camera in zip(occupied, cameras)]


def _draw(data: SkyShieldData, part: str, predictions: Predictions, path: str) -> None:
    """Draws the flight with most predicted frames: one that is held out has all, others the end."""
    # Predicting needs no drawing code; it is loaded for the picture alone.
    from ..data.actors import liveliest
    from ..report.animation import draw_flight

    frames: dict[str, list[int]] = {}
    for name, frame in data.split[part]:
        frames.setdefault(name, []).append(frame)
    most = max(map(len, frames.values()))
    clip = liveliest([data.clips[name] for name in frames if len(frames[name]) == most])
    draw_flight(clip, path, frames[clip.clip_id], predictions)
