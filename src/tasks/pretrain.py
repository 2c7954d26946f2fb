"""task=pretrain: an image encoder that knows what pixels see, for trainings to begin with."""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import lightning
import torch
from hydra.utils import get_class, instantiate
from omegaconf import DictConfig, OmegaConf
from torch.utils.data import DataLoader

from ..bounds import require_at_least, require_some
from ..data.batches import BatchesInOrder, TrainingBatches
from ..data.datamodule import SkyShieldData
from ..data.image_labels import ImageLabelDataset
from ..errors import UserError
from ..models.backbone import STRIDES, ResNet
from ..models.checkpoint import load_weights, read_content
from ..models.image_pretraining import ImagePretraining
from ..run_folder import RunFolder, version_of
from ..terminal import say
from .dataset import data_of, finished_dataset, root_of
from .encoder import write_encoder
from .precision import FP32, precision_of
from .progress import PretrainingLines

# Settings that shape trainings alone, and what a pretraining reads instead.
INSTEAD = {
    "trainer.max_epochs": "task.epochs",
    "trainer.limit_train_batches": "task.limit_train_batches",
    "data.batch_size": "task.batch_size",
    "optimizer.lr": "task.lr",
    "debug": "task.epochs=1, task.limit_train_batches=2 and a task.out to throw away",
}


def require_pretraining(task: Mapping, overridden: Iterable[str]) -> None:
    """Raises `UserError` for settings of ``task`` that train nothing, and for an overridden key
    that only other trainings read."""
    for key in overridden:
        if key in INSTEAD:
            raise UserError(f"{key}: task=pretrain reads {INSTEAD[key]} instead")
    require_at_least(1, "task", task, "epochs", "batch_size")
    require_some("task.limit_train_batches", task.get("limit_train_batches"))


def pretrain(
    cfg: DictConfig,
    out: str,
    epochs: int,
    batch_size: int,
    lr: float,
    limit_train_batches: int | float = 1.0,
) -> str:
    """Trains ``model.backbone`` on what the pixels of the training frames see.

    The labels are the voxels', cast into the image (`data.image_labels`). Validation frames measure
    it after each epoch, and test frames are not read. Leaves what `encoder` writes, whose names are
    torchvision's: `model.backbone.weights` takes it. It lies in a folder below ``out`` that is
    named after the scale and all that shapes it, so no other pretraining takes its place. Goes on
    where it was interrupted.

    Raises `UserError` for a backbone that is not a `ResNet`, a data set that is not there, and a
    checkpoint that is broken.
    """
    settings = {"epochs": epochs, "batch_size": batch_size, "lr": lr}
    settings["limit_train_batches"] = limit_train_batches
    config = {**OmegaConf.to_container(cfg, resolve=True), "pretrain": settings}
    root = root_of(cfg)
    name = f"{cfg.scale_name}-{version_of(config, root.name)}"
    folder = RunFolder(Path(out) / name, config, root.name)
    if get_class(cfg.model.backbone._target_) is not ResNet:
        raise UserError("model/backbone: task=pretrain trains a resnet; the others have their own")
    precision_of(cfg)  # refuses a device that is not there
    data = data_of(cfg, finished_dataset(cfg))
    backbone = instantiate(cfg.model.backbone)
    module = ImagePretraining(backbone, cfg.size.dim, lr, cfg.optimizer.weight_decay)
    with folder.alone():
        checkpoint = folder.open(afresh=cfg.overwrite)
        if checkpoint:
            # A broken one is refused here, in one line.
            load_weights(module, read_content(checkpoint)["state_dict"], checkpoint)
        trainer = _trainer_of(cfg, folder, epochs, limit_train_batches)
        loaders = [_loader(cfg, data, part, batch_size) for part in ("train", "val")]
        try:
            trainer.fit(module, *loaders, ckpt_path=checkpoint, weights_only=True)
        finally:
            folder.merge_metrics()
        path = write_encoder(folder.path, backbone, data)
    say(f"model.backbone.weights={path}")
    return "finished"


def _trainer_of(
    cfg: DictConfig, folder: RunFolder, epochs: int, limit: int | float
) -> lightning.Trainer:
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)
    terminal = sys.stdout.isatty()
    return instantiate(
        cfg.trainer,
        devices=1,
        precision=FP32,
        max_epochs=epochs,
        limit_train_batches=limit,  # a scale may shorten the epochs of its trainings
        callbacks=[
            instantiate(cfg.callbacks.last, dirpath=folder.last_checkpoint.parent),
            instantiate(cfg.callbacks.progress) if terminal else PretrainingLines(),
        ],
        logger=instantiate(cfg.logger, save_dir=folder.path),
        default_root_dir=folder.path,
        enable_progress_bar=terminal,
    )


def _loader(cfg: DictConfig, data: SkyShieldData, part: str, batch_size: int) -> DataLoader:
    frames = data.dataset(part, images=False)
    dataset = ImageLabelDataset(frames, data.grid, STRIDES[0])
    if part == "train":
        batches = TrainingBatches(len(frames), batch_size, cfg.seed, cfg.data.mirror)
    else:
        batches = BatchesInOrder(len(frames), batch_size)
    return data.loader(dataset, batches)
