"""task=fit: generate what is missing, train, test the best checkpoint, write what came out."""

import sys
from pathlib import Path

import lightning
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..models.module import OccupancyModule
from ..models.prior import VoxelPrior
from ..ontology import CLASSES
from ..provenance import source_digest
from ..report.results import print_results, read_results
from ..run_folder import RunFolder, code_of, require_same_config
from .checkpoint import epochs_done
from .dataset import data_of, ready_dataset
from .encoder import require_unseen
from .evaluate import evaluate
from .model import load_weights, module_of, prior_of, require_buildable
from .precision import FP32, Choice, settled_precision
from .processes import is_first_process
from .progress import EpochLines

SKIPPED = "already finished, skipped"


def fit(cfg: DictConfig) -> str:
    """Trains the configured model and leaves its run folder complete; returns how that went.

    A finished run of the same configuration and code is shown again, a half-done one goes on from
    its last checkpoint, and anything else in its place is moved aside.
    """
    folder = RunFolder(Path(cfg.paths.run), OmegaConf.to_container(cfg, resolve=True))
    if _shown_again(cfg, folder):
        return SKIPPED
    named = None if cfg.ckpt_path is None else _checkpoint_to_resume(cfg, folder)
    require_buildable(cfg)
    data = data_of(cfg, ready_dataset(cfg))
    require_unseen(cfg.model.backbone.get("weights"), data)
    prior = prior_of(cfg, data)
    module = module_of(cfg, data, prior)
    if not is_first_process():
        return _train(cfg, folder, data, prior, module, named)
    with folder.alone():
        # A process that was waited for may have finished the run.
        skipped = _shown_again(cfg, folder)
        return SKIPPED if skipped else _train(cfg, folder, data, prior, module, named)


def _shown_again(cfg: DictConfig, folder: RunFolder) -> bool:
    """Whether there is nothing to do; prints what was done before."""
    if not folder.is_finished() or cfg.overwrite or cfg.ckpt_path is not None:
        return False
    line = f"{folder.path}: already finished; overwrite=true trains it again"
    Console().print(line, highlight=False, soft_wrap=True)
    print_results(read_results(folder.results))
    return True


def _train(
    cfg: DictConfig,
    folder: RunFolder,
    data: SkyShieldData,
    prior: VoxelPrior,
    module: OccupancyModule,
    named: Path | None,
) -> str:
    first = is_first_process()
    prepare = folder.open if first else folder.to_resume
    checkpoint = named or prepare(afresh=cfg.overwrite)
    if checkpoint:
        load_weights(module, checkpoint)  # a broken one is refused here, in one line
    done = f"epoch {epochs_done(checkpoint)} of {cfg.trainer.max_epochs}" if checkpoint else ""
    # How many processes and which device, only a trainer knows.
    choice = settled_precision(cfg, folder, module, data, trainer_of(cfg, FP32))
    trainer = trainer_of(cfg, choice.precision)
    if first:
        _write_class_weights(folder, module)
        _announce(cfg, trainer, module, data, done, choice)
    try:
        trainer.fit(module, datamodule=data, ckpt_path=checkpoint, weights_only=True)
    finally:
        if first:
            folder.merge_metrics()
    load_weights(module, folder.best_checkpoint)
    evaluate(cfg, folder, trainer, module, data, prior)
    return f"finished, went on after {done}" if done else "finished"


def trainer_of(cfg: DictConfig, precision: str) -> lightning.Trainer:
    """Lightning's trainer with the configured callbacks and logger; never with ``auto``."""
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)
    callbacks = instantiate(cfg.callbacks)
    if not sys.stdout.isatty():
        callbacks["progress"] = EpochLines()
    return instantiate(
        cfg.trainer,
        precision=precision,
        callbacks=list(callbacks.values()),
        logger=instantiate(cfg.logger),
        enable_progress_bar=sys.stdout.isatty(),
    )


def _checkpoint_to_resume(cfg: DictConfig, folder: RunFolder) -> Path:
    """The checkpoint that ``ckpt_path`` names; refuses one of another run, of another configuration
    or of other code."""
    path = folder.checkpoint(cfg.ckpt_path)
    require_same_config(path, folder.config)
    if path.resolve().parent != folder.last_checkpoint.resolve().parent:
        raise UserError(
            f"ckpt_path: {path} belongs to another run than {folder.path}; set paths.run to its "
            "folder to go on with it, or task=test to score it"
        )
    if (before := code_of(folder.path)) != (now := source_digest()):
        raise UserError(
            f"ckpt_path: {path} was trained by code {before or 'unknown'}, and src/ is {now} now; "
            "go on in a checkout of the old one, or drop ckpt_path to start anew"
        )
    return path


def _write_class_weights(folder: RunFolder, module: OccupancyModule) -> None:
    weights = module.loss.class_weights
    if weights is not None:
        folder.write_json("class_weights.json", dict(zip(CLASSES, weights.tolist())))


def _announce(
    cfg: DictConfig,
    trainer: lightning.Trainer,
    module: OccupancyModule,
    data: SkyShieldData,
    done: str,
    choice: Choice,
) -> None:
    """What is about to be trained and how, in three lines."""
    parameters = sum(p.numel() for p in module.network.parameters())
    frames = " / ".join(str(len(samples)) for samples in data.split.values())
    device = trainer.strategy.root_device
    how = f"goes on after {done}" if done else f"{cfg.trainer.max_epochs} epochs"
    for line in (
        f"{cfg.name}, scale {cfg.scale_name}, seed {cfg.seed}: {parameters / 1e6:.2f} M parameters "
        f"on {device}, {how}",
        f"{data.root}: {frames} frames to train / validate / test",
        f"precision {choice.precision}: {choice.reason}",
    ):
        Console().print(line, highlight=False, soft_wrap=True)
