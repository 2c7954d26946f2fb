"""The session of a task: the run's folder, the data, the trainer and the checkpoint."""

from functools import cached_property
from pathlib import Path

import lightning
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..models.checkpoint import Checkpoint
from ..models.network import SkyOcc
from ..models.weights import trained_on
from ..provenance import git_commit
from ..run_folder import KEYS, RunFolder, require_same_config
from .dataset import finished_dataset, ready_dataset, root_of
from .trainer import trainer_of


class Session:
    """The work of one command on one configuration.

    Its parts are made when they are first asked for, so a task refuses only what it needs, and in
    the order in which it asks: export makes no data, and a device that is not there is refused
    before any data are made. With ``generates`` missing clips are made; else the dataset must be
    finished. With ``allow_missing`` the frames of clips that are not there are left out.
    """

    def __init__(
        self, cfg: DictConfig, generates: bool = False, allow_missing: bool = False
    ) -> None:
        self.cfg = cfg
        self.generates, self.allow_missing = generates, allow_missing

    @cached_property
    def folder(self) -> RunFolder:
        config = OmegaConf.to_container(self.cfg, resolve=True)
        return RunFolder(Path(self.cfg.paths.run), config, root_of(self.cfg).name)

    @cached_property
    def trainer(self) -> lightning.Trainer:
        return trainer_of(self.cfg)

    @cached_property
    def data(self) -> SkyShieldData:
        root = ready_dataset(self.cfg) if self.generates else finished_dataset(self.cfg)
        return data_of(self.cfg, root, self.allow_missing)

    def checkpoint(self, task: str) -> Checkpoint:
        """Reads the checkpoint that ``ckpt_path`` names, for the task of that name.

        Raises `UserError` without one, where it is none, and where its run had another name, seed,
        model, loss or history step: the weights of one rung fit another, and would be used with the
        wrong projection, or their scores be called those of another rung. So it is with a clip that
        is held out here, and that its run was trained on.
        """
        if self.cfg.ckpt_path is None:
            raise UserError(f"ckpt_path: task={task} needs a checkpoint; give best, last or a file")

        checkpoint = Checkpoint.read(self.folder.checkpoint(self.cfg.ckpt_path))
        config = checkpoint.origin.config
        # A network without a past has no step.
        steps = ["data.history_step_s"] if self.cfg.data.frames > 1 else []
        keys = (*KEYS["identity"], *steps)
        require_same_config(checkpoint.path, config, self.folder.config, keys)
        held_out = self.cfg.data.val_clips, self.cfg.data.test_clips
        own, here = checkpoint.origin.dataset, root_of(self.cfg).name
        for key, clips in zip(("val_clips", "test_clips"), held_out):
            if seen := trained_on(own, config, here, self.folder.config["sim"], clips):
                raise UserError(
                    f"data.{key}: {checkpoint.path} was trained on {seen[0]}; name clips that its "
                    "run held out"
                )
        return checkpoint

    def facts(self, network: SkyOcc) -> dict[str, object]:
        """Returns the facts stored beside predictions and scores, such as seed and commit."""
        return {
            "seed": self.cfg.seed,
            "scale": self.cfg.scale_name,
            "recipe": self.cfg.recipe_name,
            "dataset": self.data.root.name,
            "code_version": self.folder.version,
            "git_commit": git_commit(),
            "parameters": sum(p.numel() for p in network.parameters()),
            "precision": self.trainer.precision,
        }


def data_of(cfg: DictConfig, root: Path, allow_missing: bool = False) -> SkyShieldData:
    """Opens the loaders of a finished dataset; seeds everything that training draws from."""
    # Here, because every task that draws at random opens the data first.
    lightning.seed_everything(cfg.seed, workers=True, verbose=False)
    settings = instantiate(cfg.data, _convert_="all")
    return SkyShieldData(root, seed=cfg.seed, allow_missing=allow_missing, **settings)
