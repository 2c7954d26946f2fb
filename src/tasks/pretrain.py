"""task=pretrain: an image encoder that knows the classes of pixels, for trainings to begin with."""

import hashlib
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import torch
from hydra.utils import get_class, instantiate
from omegaconf import DictConfig, OmegaConf
from torch import nn
from torch.utils.data import DataLoader

from ..atomic import replacing
from ..bounds import require_at_least, require_some
from ..data.batches import BatchesInOrder, TrainingBatches
from ..data.datamodule import SkyShieldData
from ..data.image_labels import ImageLabelDataset
from ..data.split import held_out_clips
from ..errors import UserError
from ..models.backbone import STRIDES, ResNet
from ..models.checkpoint import load_weights, read_content
from ..models.image_pretraining import ImagePretraining
from ..models.weights import ORIGIN, read_encoder
from ..run_folder import RunFolder, version_of
from ..terminal import say
from .session import Session
from .trainer import FP32, PretrainingLines, precision_of, trainer_of

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
    """Trains ``model.backbone`` on the classes of the pixels of the training frames.

    The labels are the voxels', cast into the image (`data.image_labels`). Validation frames measure
    it after each epoch, and test frames are not read. Leaves the file of `write_encoder`, whose
    names are torchvision's: `model.backbone.weights` takes it. It lies in a folder below ``out``
    that is named after the scale and all that shapes it, so no other pretraining takes its place.
    Goes on where it was interrupted.

    Raises `UserError` for a backbone that is not a `ResNet`, a dataset that is not there, and a
    checkpoint that is broken.
    """
    if get_class(cfg.model.backbone._target_) is not ResNet:
        raise UserError("model/backbone: task=pretrain trains a resnet; the others have their own")
    precision_of(cfg)  # refuses a device that is not there
    data = Session(cfg).data
    settings = {"epochs": epochs, "batch_size": batch_size, "lr": lr}
    settings["limit_train_batches"] = limit_train_batches
    config = {**OmegaConf.to_container(cfg, resolve=True), "pretrain": settings}
    name = f"{cfg.scale_name}-{version_of(config, data.root.name)}"
    folder = RunFolder(Path(out) / name, config, data.root.name)
    backbone = instantiate(cfg.model.backbone)
    module = ImagePretraining(backbone, cfg.size.dim, lr, cfg.optimizer.weight_decay)

    with folder.alone():
        loaders = [_loader(cfg, data, part, batch_size) for part in ("train", "val")]
        _train(cfg, folder, module, loaders, epochs, limit_train_batches)
        path = write_encoder(folder.path, backbone, data)
    say(f"model.backbone.weights={path}")
    return "finished"


def _train(
    cfg: DictConfig,
    folder: RunFolder,
    module: ImagePretraining,
    loaders: Sequence[DataLoader],
    epochs: int,
    limit: int | float,
) -> None:
    """Trains the module in its folder, from the last checkpoint there if there is one: as
    configured, but on one device and in fp32."""
    checkpoint = folder.open(afresh=cfg.overwrite)
    if checkpoint:
        # A broken one is refused here, in one line.
        load_weights(module, read_content(checkpoint)["state_dict"], checkpoint)

    own = cfg.copy()
    OmegaConf.set_struct(own, False)
    own.paths.run = str(folder.path)
    own.callbacks = {name: cfg.callbacks[name] for name in ("last", "progress")}
    own.callbacks.last.dirpath = str(folder.last_checkpoint.parent)
    # A scale may shorten the epochs of its trainings; a pretraining has a limit of its own.
    own.trainer.update(devices=1, precision=FP32, max_epochs=epochs, limit_train_batches=limit)
    trainer = trainer_of(own, PretrainingLines())
    try:
        trainer.fit(module, *loaders, ckpt_path=checkpoint, weights_only=True)
    finally:
        folder.merge_metrics()


def _loader(cfg: DictConfig, data: SkyShieldData, part: str, batch_size: int) -> DataLoader:
    """Returns the loader of a part, whose labels are those of the pixels of the feature map."""
    frames = data.dataset(part, images=False)
    dataset = ImageLabelDataset(frames, data.grid, STRIDES[0])
    if part == "train":
        batches = TrainingBatches(len(frames), batch_size, cfg.seed, cfg.data.mirror)
    else:
        batches = BatchesInOrder(len(frames), batch_size)
    return data.loader(dataset, batches)


def write_encoder(folder: Path, backbone: nn.Module, data: SkyShieldData) -> Path:
    """Writes ``image_encoder-<hash>.pth``, which is named after its content as `models.weights`
    wants it. Beside the weights it holds the dataset's name and the clips that were held out."""
    origin = {"dataset": data.root.name, "held_out": held_out_clips(data.split)}
    content = io.BytesIO()  # given a path, torch.save writes its name into the file
    torch.save({"state_dict": backbone.state_dict(), ORIGIN: origin}, content)

    digest = hashlib.sha256(content.getvalue()).hexdigest()
    path = folder / f"image_encoder-{digest[:8]}.pth"
    with replacing(path) as temporary:
        temporary.write_bytes(content.getvalue())
    return path


def require_unseen(weights: str | None, data: SkyShieldData) -> None:
    """Raises `UserError` where an encoder of `write_encoder` was trained on a clip that is held out
    for the test, whose labels it has learnt; and where one of our own does not say its clips.

    Nothing is known of a published file. Clips of another dataset are other flights, whatever
    their names.
    """
    path = Path(weights or "")
    if not path.is_file():
        return
    _, origin = read_encoder(path)
    if not origin and path.name.startswith("image_encoder"):
        raise UserError(
            f"model.backbone.weights: {path} does not say which flights it was trained on, as "
            "files of task=pretrain do now; run task=pretrain again"
        )
    if not origin or origin["dataset"] != data.root.name:
        return

    known = {*origin["held_out"]["val"], *origin["held_out"]["test"]}
    seen = [clip for clip in held_out_clips(data.split)["test"] if clip not in known]
    if seen:
        raise UserError(
            f"model.backbone.weights: {weights} was trained on {seen[0]}, which this run holds out "
            f"for its test ({len(seen)} such clips); run task=pretrain with the same split"
        )
