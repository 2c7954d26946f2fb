"""A checkpoint, as the tasks that come after the training take it up."""

from collections.abc import Sequence
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from ..errors import UserError
from ..models.checkpoint import Checkpoint
from ..run_folder import IDENTITY, NOT_SHAPING, RunFolder, require_same_config
from .dataset import root_of

HERE = ("callbacks", "trainer")
"""What of a checkpoint's configuration is of the machine that trained it."""
NEUTRAL = (*NOT_SHAPING, "data.batch_size", "metric", "suite", *HERE)
"""Keys, and beginnings of keys, that say nothing of a trained model."""


def adopted(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """The configuration to work with: that of the checkpoint, where a command names the file of one
    and nothing that shapes a model, else ``cfg``.

    ``overrides`` are the words of the command line. Raises `UserError` as `Checkpoint.read` does.
    """
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    keys = [override.key_or_group for override in parsed]
    if cfg.ckpt_path in (None, "best", "last") or not all(map(_is_neutral, keys)):
        return cfg
    own = Checkpoint.read(cfg.ckpt_path).origin.config

    adopted, taken = cfg.copy(), own.keys() - set(HERE)
    OmegaConf.set_struct(adopted, False)
    for key in taken:
        adopted[key] = own[key]
    adopted.trainer.precision = own["trainer"]["precision"]
    # Arguments of metrics refer to shared settings, which the command may set: not their values.
    adopted.suite.metrics = OmegaConf.merge(own["suite"].get("metrics", {}), cfg.suite.metrics)

    # What the checkpoint does not say, or the command says itself.
    unsaid = [key for key in NOT_SHAPING if key.partition(".")[0] in taken]
    for key in (*unsaid, *keys):
        if "." in key:
            OmegaConf.update(adopted, key, OmegaConf.select(cfg, key))
    return adopted


def _is_neutral(key: str) -> bool:
    return any(key == known or key.startswith(f"{known}.") for known in NEUTRAL)


def trained(cfg: DictConfig, task: str) -> tuple[RunFolder, Checkpoint]:
    """The folder of the run that a configuration names, and what ``ckpt_path`` names.

    Raises `UserError` without one, where it is none, and where its run had another name, seed,
    model or loss: the weights of one rung fit another, and would be used with the wrong projection,
    or their scores be called those of another rung.
    """
    if cfg.ckpt_path is None:
        raise UserError(f"ckpt_path: task={task} needs a checkpoint; give best, last or a file")
    config = OmegaConf.to_container(cfg, resolve=True)
    run = RunFolder(Path(cfg.paths.run), config, root_of(cfg).name)
    checkpoint = Checkpoint.read(run.checkpoint(cfg.ckpt_path))
    require_same_config(checkpoint.path, checkpoint.origin.config, config, IDENTITY)
    return run, checkpoint
