"""The configuration, the data and the machine of a study, and the way that it is run."""

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from inspect import BoundArguments, Parameter, signature
from pathlib import Path
from typing import get_args, get_origin

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


def run(main: Callable[..., None]) -> None:
    """Runs a study, with its arguments from the command line, as run.py runs a task: without
    warnings, each mistake in one line."""
    quiet_libraries()
    keep_freed_memory()
    with told_in_one_line():
        arguments = arguments_of(main, sys.argv[1:])
        main(*arguments.args, **arguments.kwargs)


def arguments_of(main: Callable[..., None], words: Sequence[str]) -> BoundArguments:
    """Reads the arguments of a function from the words of a command line.

    Those that have to be given by their name are options: ``out_folder: Path`` is
    ``--out-folder``, a tuple takes several words, and a bool none.
    """
    text = sys.modules[main.__module__].__doc__
    parser = ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)
    expected = signature(main)
    for name, each in expected.parameters.items():
        option, kind = f"--{name.replace('_', '-')}", each.annotation
        if each.kind is not Parameter.KEYWORD_ONLY:
            several = {"nargs": "*"} if each.kind is Parameter.VAR_POSITIONAL else {}
            parser.add_argument(name, type=kind, **several)
        elif kind is bool:
            parser.add_argument(option, action="store_true")
        else:
            several = {"nargs": "+"} if get_origin(kind) is tuple else {}
            needed = {"required": each.default is Parameter.empty, "default": each.default}
            parser.add_argument(option, type=(*get_args(kind), kind)[0], **several, **needed)
    return BoundArguments(expected, vars(parser.parse_args(words)))


def device() -> torch.device:
    """Returns the GPU where there is one, and otherwise the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def device_name() -> str:
    """Returns the name of the GPU or of the processor, and the number of threads."""
    name = torch.cuda.get_device_name() if torch.cuda.is_available() else machine()
    return f"{name}, {torch.get_num_threads()} thread(s)"
