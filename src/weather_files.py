"""Weathers of one's own: a file in the group ``sim/weather``, named in ``sim.weathers``."""

from collections.abc import Sequence

from hydra import compose
from hydra.errors import MissingConfigException
from omegaconf import DictConfig, open_dict

from .settings import search_path


def add_named_weathers(cfg: DictConfig, of_hydra: Sequence[str]) -> None:
    """Adds to ``sim.weather`` what ``sim.weathers`` names and no file lists in its defaults.

    ``of_hydra`` are the overrides that set Hydra itself, such as the folders with groups of one's
    own. A name without a file is left to the generator, which knows all weathers that there are.
    Must be called inside Hydra's application.
    """
    for name in cfg.sim.weathers:
        if name in cfg.sim.weather or not str(name).isidentifier():
            continue
        package = f"sim.weather.{name}"
        try:
            added = compose("config", [f"+sim/weather@{package}={name}", *search_path(of_hydra)])
        except MissingConfigException:
            continue
        with open_dict(cfg):
            cfg.sim.weather[name] = added.sim.weather[name]
