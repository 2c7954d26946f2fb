"""A run's checkpoint, as the tasks that come after the training take it up."""

from pathlib import Path
from typing import NamedTuple

from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..models.module import OccupancyModule
from ..models.prior import VoxelPrior
from ..run_folder import CONFIG, IDENTITY, RunFolder, require_same_config
from .dataset import data_of, ready_dataset
from .model import from_checkpoint, load_weights, module_of, prior_of, require_buildable
from .precision import precision_of_run


class Trained(NamedTuple):
    """A configured run with the weights of a checkpoint; ``precision`` is what it computes in."""

    run: RunFolder
    data: SkyShieldData
    prior: VoxelPrior
    module: OccupancyModule
    precision: str


def trained(cfg: DictConfig, task: str) -> Trained:
    """What ``ckpt_path`` names, filled into the configured model.

    Raises `UserError` without one, where it is none, and where its run had another name, seed,
    model or loss: the weights of one rung fit another, and would be used with the wrong projection,
    or their scores be called those of another rung.
    """
    if cfg.ckpt_path is None:
        raise UserError(f"ckpt_path: task={task} needs a checkpoint; give best, last or a file")
    run = RunFolder(Path(cfg.paths.run), OmegaConf.to_container(cfg, resolve=True))
    checkpoint = run.checkpoint(cfg.ckpt_path)
    its_run = checkpoint.parent.parent
    if (its_run / CONFIG).is_file():
        require_same_config(checkpoint, run.config, IDENTITY)
    cfg = from_checkpoint(cfg)
    require_buildable(cfg)
    data = data_of(cfg, ready_dataset(cfg))
    prior = prior_of(cfg, data)
    module = module_of(cfg, data, prior)
    load_weights(module, checkpoint)
    return Trained(run, data, prior, module, precision_of_run(cfg, its_run))
