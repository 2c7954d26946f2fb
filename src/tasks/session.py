"""The session of a task: the run's folder, the data, the trainer and the checkpoint."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import lightning
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..metrics.protocol import without_former
from ..models.checkpoint import Checkpoint
from ..models.network import SkyOcc
from ..provenance import git_commit
from ..run_folder import KEYS, RunFolder, is_listed, require_same_config
from .dataset import data_of, finished_dataset, ready_dataset, root_of
from .trainer import trainer_of

LOOK = "src.tasks.look.look"


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
        model or loss: the weights of one rung fit another, and would be used with the wrong
        projection, or their scores be called those of another rung.
        """
        if self.cfg.ckpt_path is None:
            raise UserError(f"ckpt_path: task={task} needs a checkpoint; give best, last or a file")

        checkpoint = Checkpoint.read(self.folder.checkpoint(self.cfg.ckpt_path))
        config = checkpoint.origin.config
        require_same_config(checkpoint.path, config, self.folder.config, KEYS["identity"])
        return checkpoint

    def facts(self, network: SkyOcc) -> dict[str, object]:
        """Returns what is said of a network beside its predictions and its scores."""
        return {
            "seed": self.cfg.seed,
            "scale": self.cfg.scale_name,
            "dataset": self.data.root.name,
            "code_version": self.folder.version,
            "git_commit": git_commit(),
            "parameters": sum(p.numel() for p in network.parameters()),
            "precision": self.trainer.precision,
        }


def adopted(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """Returns the configuration to work with: the checkpoint's, where a command names the file of
    one and nothing that shapes a model, else ``cfg``.

    ``overrides`` are those of the command line. task=look shows other flights than those that the
    weights were trained on: which, its own configuration says. Raises `UserError` as
    `Checkpoint.read` does.
    """
    # An override of the model names another rung, whose configuration must then be given whole.
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    keys = [override.key_or_group for override in parsed]
    flights = KEYS["flights"] if cfg.task._target_ == LOOK else ()
    says_nothing = (*KEYS["place"], *KEYS["machine"], *KEYS["scoring"], *flights)
    neutral = all(is_listed(key, says_nothing) for key in keys)
    if cfg.ckpt_path in (None, "best", "last") or not neutral:
        return cfg

    own = Checkpoint.read(cfg.ckpt_path).origin.config
    adopted, taken = cfg.copy(), own.keys() - set(KEYS["machine"])
    OmegaConf.set_struct(adopted, False)
    for key in taken:
        adopted[key] = own[key]
    # The trainer is this machine's, but scores depend on the precision.
    adopted.trainer.precision = own["trainer"]["precision"]
    # A metric that is newer than the checkpoint, and its settings, are of the command's suite.
    suite = without_former(own["suite"])
    adopted.suite = OmegaConf.merge({}, cfg.suite, suite)
    # Arguments of metrics refer to shared settings, which the command may set: not their values.
    adopted.suite.metrics = OmegaConf.merge(suite.get("metrics", {}), cfg.suite.metrics)

    # What the checkpoint does not say, or the command says itself.
    unsaid = [key for key in KEYS["place"] if key.partition(".")[0] in taken]
    for key in (*unsaid, *flights, *keys):
        if "." in key:
            OmegaConf.update(adopted, key, OmegaConf.select(cfg, key))
    return adopted
