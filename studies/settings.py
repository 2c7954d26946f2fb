"""The configuration, the data and the machine of a study, and the way that it is run."""

from collections.abc import Callable, Sequence
from pathlib import Path

import torch
import yaml
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, open_dict

from src.data.datamodule import SkyShieldData
from src.errors import UserError, reason_of
from src.failures import quiet_libraries, told_in_one_line
from src.heap import keep_freed_memory
from src.provenance import machine
from src.settings import GROUPS, require_sound
from src.tasks.dataset import finished_dataset
from src.tasks.session import data_of


def composed(overrides: Sequence[str]) -> DictConfig:
    """Composes the configuration of run.py with the overrides of a command line, and checks it."""
    with initialize_config_dir(str(GROUPS.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=list(overrides), return_hydra_config=True)
        require_sound(cfg, cfg.hydra)
    with open_dict(cfg):
        del cfg.hydra
    return cfg


def read_plan(path: Path, *keys: str) -> dict:
    """Reads a study's plan. Raises `UserError` where it cannot be read or lacks a key."""
    try:
        plan = yaml.safe_load(path.read_text())
        missing = [key for key in keys if key not in plan]
    except (OSError, TypeError, yaml.YAMLError) as error:
        raise UserError(f"--plan: {path} cannot be read ({reason_of(error)})") from error
    if missing:
        raise UserError(f"--plan: {path} has no {missing[0]!r}; a plan has {', '.join(keys)}")
    return plan


def composed_with_data(overrides: Sequence[str]) -> tuple[DictConfig, SkyShieldData]:
    """Composes a configuration and opens its dataset, which must be finished."""
    cfg = composed(overrides)
    return cfg, data_of(cfg, finished_dataset(cfg))


def run(main: Callable[[], None]) -> None:
    """Runs a study as run.py runs a task: without warnings, each mistake in one line."""
    quiet_libraries()
    keep_freed_memory()
    with told_in_one_line():
        main()


def device() -> torch.device:
    """Returns the GPU where there is one, and otherwise the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def device_name() -> str:
    """Returns the name of the GPU or of the processor, and the number of threads."""
    name = torch.cuda.get_device_name() if torch.cuda.is_available() else machine()
    return f"{name}, {torch.get_num_threads()} thread(s)"
