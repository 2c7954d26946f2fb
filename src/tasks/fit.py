"""task=fit: generate what is missing, train, test the best checkpoint, write what came out."""

import sys
from pathlib import Path

import lightning
import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..models.checkpoint import Checkpoint, load_weights
from ..models.module import OccupancyModule
from ..ontology import CLASSES
from ..provenance import different_file
from ..results.files import print_results, read_results
from ..run_folder import RunFolder, require_same_config, shaping
from ..terminal import say
from .dataset import data_of, ready_dataset, root_of
from .encoder import require_unseen
from .evaluate import evaluate
from .model import module_of, network_of, origin_of, require_buildable
from .precision import precision_of
from .processes import is_first_process
from .progress import EpochLines

SKIPPED = "already finished, skipped"


def fit(cfg: DictConfig) -> str:
    """Trains the configured model and leaves its run folder complete; returns how that went.

    A finished run of the same configuration and code is shown again, a half-done one goes on from
    its last checkpoint, and anything else in its place is moved aside.
    """
    config = OmegaConf.to_container(cfg, resolve=True)
    folder = RunFolder(Path(cfg.paths.run), config, root_of(cfg).name)
    if _shown_again(cfg, folder):
        return SKIPPED

    # What cannot be done is refused before anything is made or moved aside.
    trainer = trainer_of(cfg)
    named = None if cfg.ckpt_path is None else _checkpoint_to_resume(cfg, folder)
    require_buildable(cfg)
    data = data_of(cfg, ready_dataset(cfg))
    require_unseen(cfg.model.backbone.get("weights"), data)

    if not is_first_process():
        return _train(cfg, folder, trainer, data, named)
    with folder.alone():
        # A process that was waited for may have finished the run.
        skipped = _shown_again(cfg, folder)
        return SKIPPED if skipped else _train(cfg, folder, trainer, data, named)


def _shown_again(cfg: DictConfig, folder: RunFolder) -> bool:
    """Whether there is nothing to do; prints what was done before."""
    if not folder.is_finished() or cfg.overwrite or cfg.ckpt_path is not None:
        return False
    say(f"{folder.path}: already finished; overwrite=true trains it again")
    print_results(read_results(folder.results))
    return True


def _train(
    cfg: DictConfig,
    folder: RunFolder,
    trainer: lightning.Trainer,
    data: SkyShieldData,
    named: Path | None,
) -> str:
    path = named or folder.to_resume(afresh=cfg.overwrite)

    # A broken checkpoint is refused here, in one line.
    checkpoint = None if path is None else Checkpoint.read(path)
    origin = checkpoint.origin if checkpoint else origin_of(cfg, data, folder)
    module = module_of(cfg, data, network_of(cfg, origin), origin)
    done = f"epoch {checkpoint.epochs} of {cfg.trainer.max_epochs}" if checkpoint else ""
    if checkpoint:
        load_weights(module, checkpoint.state, path)

    # Nothing is left to refuse: now what is in the way of this run may move aside.
    if first := is_first_process():
        if named is None:
            folder.open(afresh=cfg.overwrite)
        _write_class_weights(folder, module)
        _announce(cfg, trainer, module, data, done)
    try:
        trainer.fit(module, datamodule=data, ckpt_path=path, weights_only=True)
    finally:
        if first:
            folder.merge_metrics()

    load_weights(module, Checkpoint.read(folder.best_checkpoint).state, folder.best_checkpoint)
    evaluate(cfg, folder, trainer, module, data)
    return f"finished, went on after {done}" if done else "finished"


def trainer_of(cfg: DictConfig) -> lightning.Trainer:
    """Lightning's trainer with the configured callbacks and logger, in the precision that
    `precision_of` says. Raises `UserError` for a device or a precision that is not to be had."""
    precision = precision_of(cfg)
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)

    callbacks = instantiate(cfg.callbacks)
    if not sys.stdout.isatty():
        callbacks["progress"] = EpochLines()
    settings = {
        "precision": precision,
        "callbacks": list(callbacks.values()),
        "logger": instantiate(cfg.logger),
        "enable_progress_bar": sys.stdout.isatty(),
    }
    try:
        return instantiate(cfg.trainer, **settings)
    except InstantiationException as error:
        reason = " ".join(str(error.__cause__ or error).split())
        raise UserError(f"trainer: {reason}; see conf/trainer/default.yaml") from error


def _checkpoint_to_resume(cfg: DictConfig, folder: RunFolder) -> Path:
    """The checkpoint that ``ckpt_path`` names; refuses one of another run, of another configuration
    or of other code."""
    path = folder.checkpoint(cfg.ckpt_path)
    origin = Checkpoint.read(path).origin
    require_same_config(path, origin.config, {**shaping(folder.config), "name": cfg.name})
    if path.resolve().parent != folder.last_checkpoint.resolve().parent:
        raise UserError(
            f"ckpt_path: {path} belongs to another run than {folder.path}; set paths.run to its "
            "folder to go on with it, or task=test to score it"
        )
    if file := different_file(origin.code, folder.code):
        raise UserError(
            f"ckpt_path: {path} was trained by other code: src/{file} differs; go on in a checkout "
            "of that code, or drop ckpt_path to start anew"
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
) -> None:
    """What is about to be trained and how, in two lines."""
    parameters = sum(p.numel() for p in module.network.parameters())
    frames = " / ".join(str(len(samples)) for samples in data.split.values())
    device = trainer.strategy.root_device
    how = f"goes on after {done}" if done else f"{cfg.trainer.max_epochs} epochs"
    say(
        f"{cfg.name}, scale {cfg.scale_name}, seed {cfg.seed}: {parameters / 1e6:.2f} M parameters "
        f"on {device} in {trainer.precision}, {how}"
    )
    say(f"{data.root}: {frames} frames to train / validate / test")
