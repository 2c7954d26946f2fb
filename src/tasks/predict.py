"""task=predict: writes a checkpoint's labels of one part of the split, for task=score or others."""

from collections.abc import Iterator
from pathlib import Path

import torch
from omegaconf import DictConfig

from ..data.datamodule import SkyShieldData
from ..data.predictions import PredictedFrame, Predictions, save_predictions
from ..data.split import PARTS, held_out_clips
from ..errors import UserError
from ..limits import require_choice
from ..terminal import say, tracked
from .model import require_heights
from .session import Session
from .trainer import predictor


def predict(cfg: DictConfig, part: str, logits: bool, animation: str | None = None) -> None:
    """Writes ``predictions`` (null: ``predictions/<part>`` under the run) and prints where.

    Clips that are not on the disk any more are left out. An ``animation`` is a GIF of one flight of
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
            scores = scores_of(batch)
            for n, (clip, frame) in enumerate(zip(batch["clip"], batch["frame"])):
                labels = scores[n].argmax(dim=0).to(torch.uint8)
                yield clip, int(frame), labels, scores[n] if logits else None

    # The folder appears under its name when all frames are in it.
    save_predictions(folder, facts | session.facts(network), frames())
    if animation is not None:
        _draw(data, part, Predictions(folder), animation)
        say(animation)
    missing = f"; {len(data.missing)} clips are not there" if data.missing else ""
    say(f"{folder}: {len(data.split[part])} frames{missing}")


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
