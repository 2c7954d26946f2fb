"""task=fit: generate what is missing, train, test the best checkpoint, write what came out."""

from pathlib import Path

import lightning
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from ..errors import UserError
from ..ontology import CLASSES
from ..report.results import print_results, read_results
from ..run_folder import RunFolder
from .dataset import data_of, ready_dataset
from .evaluate import evaluate
from .model import load_weights, module_of, prior_of



def fit(cfg: DictConfig) -> None:
    """Trains the configured model and leaves its run folder complete.

    A finished run of the same configuration and code is shown again, a half-done one goes on from
    its last checkpoint, and anything else in its place is moved aside.
    """
    folder = RunFolder(Path(cfg.paths.run), OmegaConf.to_container(cfg, resolve=True))
    console = Console()
    if folder.is_finished() and not cfg.overwrite and cfg.ckpt_path is None:
        console.print(f"{folder.path}: already finished; overwrite=true trains it again")
        print_results(read_results(folder.results))
        return
    data = data_of(cfg, ready_dataset(cfg))
    checkpoint = _where_to_start(cfg, folder)
    prior = prior_of(cfg, data)
    module = module_of(cfg, data, prior)
    weights = module.loss.class_weights
    if weights is not None:
        folder.write_json("class_weights.json", dict(zip(CLASSES, weights.tolist())))
    trainer = trainer_of(cfg)
    try:
        trainer.fit(module, datamodule=data, ckpt_path=checkpoint, weights_only=True)
    finally:
        folder.merge_metrics()
    load_weights(module, folder.best_checkpoint)
    evaluate(cfg, folder, trainer, module, data, prior)


def _where_to_start(cfg: DictConfig, folder: RunFolder) -> Path | None:
    """The checkpoint to resume from; refuses one of another configuration."""
    if cfg.ckpt_path is None:
        return folder.open(afresh=cfg.overwrite)
    folder.require_same_config()
    path = folder.last_checkpoint if cfg.ckpt_path == "last" else Path(cfg.ckpt_path)
    if not path.is_file():
        raise UserError(f"ckpt_path: no checkpoint {path}; drop the key to start from the beginning")
    return path


def trainer_of(cfg: DictConfig) -> lightning.Trainer:
    """Lightning's trainer with the configured callbacks and logger."""
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)
    return instantiate(
        cfg.trainer,
        callbacks=list(instantiate(cfg.callbacks).values()),
        logger=instantiate(cfg.logger),
    )
