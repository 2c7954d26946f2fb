"""task=predict: writes a checkpoint's labels of one part of the split, for task=score or others."""

from pathlib import Path

import torch
from omegaconf import DictConfig

from ..data.datamodule import SkyShieldData
from ..data.predictions import PredictionWriter
from ..data.split import held_out_clips
from ..data.truth import PARTS
from ..errors import UserError
from ..provenance import git_commit
from ..terminal import say, tracked
from .dataset import data_of, finished_dataset
from .fit import trainer_of
from .predictor import Predictor, predictor
from .trained import trained


def predict(cfg: DictConfig, part: str, logits: bool) -> None:
    """Writes ``predictions`` (null: ``predictions/<part>`` under the run) and prints where.

    Of clips that are not on the disk any more nothing is predicted. Raises `UserError` without a
    checkpoint, for one of another model, where no clip is left, and where the folder exists.
    """
    if part not in PARTS:
        raise UserError(f"task.part: {part!r}; there are {', '.join(PARTS)}")
    trainer = trainer_of(cfg)
    run, checkpoint = trained(cfg, "predict")
    data, network = data_of(cfg, finished_dataset(cfg), allow_missing=True), checkpoint.network()
    if not data.split[part]:
        raise UserError(f"{data.root}: no clip of the {part} frames is there; run task=generate")
    folder = Path(cfg.predictions) if cfg.predictions else run.path / "predictions" / part
    facts = {
        "name": cfg.name,
        "seed": cfg.seed,
        "scale": cfg.scale_name,
        "dataset": data.root.name,
        "part": part,
        "held_out": held_out_clips(data.split),
        "code_version": run.version,
        "git_commit": git_commit(),
        "parameters": sum(p.numel() for p in network.parameters()),
        "precision": trainer.precision,
    }
    scores_of = predictor(network, trainer)
    with PredictionWriter(folder, facts) as writer:
        _write(writer, scores_of, data, part, logits)
    missing = f"; {len(data.missing)} clips are not there" if data.missing else ""
    say(f"{folder}: {len(data.split[part])} frames{missing}")


def _write(
    writer: PredictionWriter, scores_of: Predictor, data: SkyShieldData, part: str, logits: bool
) -> None:
    for batch in tracked(data.in_order(part), f"predicting {part}"):
        scores = scores_of(batch)
        for n, (clip, frame) in enumerate(zip(batch["clip"], batch["frame"])):
            labels = scores[n].argmax(dim=0).to(torch.uint8)
            writer.add(clip, int(frame), labels, scores[n] if logits else None)
