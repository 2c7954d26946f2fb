"""A composed configuration: checked before any work starts, and weathers of one's own added."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from hydra import compose
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import MissingConfigException
from omegaconf import DictConfig, OmegaConf, open_dict

from .bounds import require_at_least, require_choice, require_count, require_some
from .data.dataset import history_stride, require_loading
from .data.rates import require_rates
from .errors import UserError
from .geometry import VoxelGrid
from .keys import plain, require_known, require_set_soundly, require_type
from .models.network import require_size

GROUPS = Path(__file__).parent.parent / "conf"
TRAINING = "src.tasks.fit.fit"
# Geometry is computed in fp32, so the network has no pure half or double precision.
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed")


def search_path(hydra_overrides: Sequence[str]) -> list[str]:
    """Returns the overrides of Hydra itself that name folders with groups of one's own."""
    return [override for override in hydra_overrides if override.startswith("hydra.searchpath=")]


def require_sound(
    cfg: DictConfig, overrides: Sequence[str], hydra_overrides: Sequence[str] = ()
) -> None:
    """Raises `UserError` that names the key, for what would otherwise fail late or do nothing.

    ``overrides`` are those of the command line. Neither they nor a file that they add, such as an
    experiment's, may add a key that nothing reads or change the type of a value.
    ``hydra_overrides`` set Hydra itself. Must be called inside Hydra's application.
    """
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    groups = [override for override in parsed if (GROUPS / override.key_or_group).is_dir()]
    before = _require_sound_files(groups, search_path(hydra_overrides))
    for override in parsed:
        if override not in groups and not override.is_delete():
            key = override.key_or_group
            if override.is_add() or override.is_force_add():
                require_known(key, before, cfg)
            require_type(key, before, cfg)

    _require_training(cfg)
    require_loading(cfg.data)
    require_size(cfg.size)
    require_rates(cfg.sim)
    history_stride(cfg.data.history_step_s, cfg.sim.capture_hz)
    _require_grids(cfg)
    _require_image(cfg)


def _require_training(cfg: DictConfig) -> None:
    """Checks name, seeds, processes, optimizer and trainer, which no class of this project
    checks."""
    # Or the run's folder would lie elsewhere, or be that of all runs of the scale.
    if not cfg.name or cfg.name.startswith(".") or {"/", "\\"} & {*cfg.name}:
        raise UserError(
            f"name: {cfg.name!r} is no name of a folder; give one without slashes that does not "
            "begin with a dot"
        )
    if cfg.seed < 0:
        raise UserError(f"seed: {cfg.seed} is too small; give 0 or more")
    require_at_least(0, "sim", cfg.sim, "seed")
    require_count("threads", cfg.threads)
    require_count("sim.workers", cfg.sim.workers)

    require_at_least(0, "optimizer", cfg.optimizer, "lr", "weight_decay", "warmup")
    if cfg.optimizer.warmup > 1:
        raise UserError(f"optimizer.warmup: {cfg.optimizer.warmup} is no share; give 0 to 1")

    require_choice("trainer.precision", cfg.trainer.get("precision"), ("auto", *PRECISIONS))
    require_choice("gpu_precision", cfg.gpu_precision, PRECISIONS)
    require_at_least(1, "trainer", cfg.trainer, "max_epochs")
    for part in ("train", "val", "test"):
        name = f"limit_{part}_batches"
        require_some(f"trainer.{name}", cfg.trainer.get(name))


def _require_grids(cfg: DictConfig) -> None:
    """Checks the grid, which the dataset has as well, and the model or its volume on the ground."""
    grid = OmegaConf.to_container(cfg.grid, resolve=True)
    VoxelGrid(**grid)
    of_model = "model.decoder.grid" if cfg.model.ground is None else "model.ground.grid"
    for follower in ("sim.grid", of_model):
        for key, value in grid.items():
            if plain(OmegaConf.select(cfg, f"{follower}.{key}")) != value:
                raise UserError(f"{follower}.{key}: differs from grid.{key}; set grid.{key} alone")


def _require_image(cfg: DictConfig) -> None:
    image = cfg.sim.image
    for side in ("width", "height"):
        if image[side] < 32 or image[side] % 32:
            raise UserError(f"sim.image.{side}: {image[side]} is not a multiple of 32; take one")

    # Batch normalization in training wants more than one value a channel.
    trains = cfg.task._target_ == TRAINING
    if trains and cfg.data.batch_size == 1 and image.width == image.height == 32:
        raise UserError(
            "data.batch_size: a single image of 32x32 pixels has one pixel in the deepest feature "
            "map, too few for batch normalization; give 2 or more, or a larger sim.image"
        )


def _require_sound_files(groups: Sequence[Override], where: Sequence[str]) -> DictConfig:
    """Checks the files that may set any key, which are the scale's and the added ones, and returns
    the configuration of all chosen files.

    They may set only keys that there are, to values of their type. ``where`` says in which folders
    there are more files.
    """
    chosen = [override.input_line for override in groups]
    composed = compose("config", [*chosen, *where], return_hydra_config=True)
    before = OmegaConf.masked_copy(composed, [key for key in composed if key != "hydra"])
    choices = composed.hydra.runtime.choices
    # A task may bring groups of its own.
    task = f"task={choices['task']}"
    defaults = _default_choices(task)

    files = {each.key_or_group: choices[each.key_or_group] for each in groups if each.is_add()}
    for group, choice in files.items():
        if group in before and group not in defaults:
            line = "# @package _global_"
            raise UserError(f"{group}={choice}: the file {choice}.yaml must begin with {line!r}")

    files["scale"] = choices["scale"]
    factors = [
        f"{'' if group in defaults else '+'}{group}={choice}"
        for group, choice in choices.items()
        if group not in files and not group.startswith("hydra/") and choice != defaults.get(group)
    ]
    names = ", ".join(f"{group}={choice}" for group, choice in files.items())
    require_set_soundly(compose("config", [task, *factors, *where]), before, names)
    return before


@cache
def _default_choices(task: str) -> dict[str, str]:
    """Returns the option of every group where the command line chooses none but the task."""
    return dict(compose("config", [task], return_hydra_config=True).hydra.runtime.choices)


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
