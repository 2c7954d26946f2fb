"""What a composed configuration must satisfy before any work starts."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from hydra import compose
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf

from .data.batches import ORDERS
from .data.dataset import HISTORY, history_stride
from .data.rates import require_rates
from .errors import UserError
from .geometry import VoxelGrid
from .keys import plain, require_known, require_set_soundly, require_type

GROUPS = Path(__file__).parent.parent / "conf"
TRAINING = "src.tasks.fit.fit"
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed")
"""Geometry is computed in fp32, so the network has no pure half or double precision."""
CHOICES = {
    **{"trainer.precision": ("auto", *PRECISIONS), "gpu_precision": PRECISIONS},
    **{"data.order": ORDERS, "data.history": HISTORY},
}
LIMITS = (
    *(f"trainer.limit_{part}_batches" for part in ("train", "val", "test")),
    "task.limit_train_batches",
)
AT_LEAST = {
    "seed": 0,
    "sim.seed": 0,
    "data.batch_size": 1,
    "data.workers": 0,
    "data.frames": 1,
    "data.run_frames": 1,
    **dict.fromkeys((f"size.{key}" for key in ("backbone_width", "dim", "layers", "heads")), 1),
    **dict.fromkeys(("size.heights", "size.points"), 1),
    "size.blocks": 0,
    "trainer.max_epochs": 1,
    **dict.fromkeys((f"optimizer.{key}" for key in ("lr", "weight_decay", "warmup")), 0),
    **dict.fromkeys(("task.epochs", "task.batch_size"), 1),
    "threads": 1,
}


PRETRAINING = "src.tasks.pretrain.pretrain"
INSTEAD = {
    "trainer.max_epochs": "task.epochs",
    "trainer.limit_train_batches": "task.limit_train_batches",
    "data.batch_size": "task.batch_size",
    "optimizer.lr": "task.lr",
    "debug": "task.epochs=1, task.limit_train_batches=2 and a task.out to throw away",
}
"""What shapes trainings alone, and what a pretraining reads instead."""


def search_path(of_hydra: Sequence[str]) -> list[str]:
    """Of the words that set Hydra itself, the one that names folders with groups of one's own."""
    return [word for word in of_hydra if word.startswith("hydra.searchpath=")]


def require_sound(cfg: DictConfig, overrides: Sequence[str], of_hydra: Sequence[str] = ()) -> None:
    """Raises `UserError` that names the key, for what would otherwise fail late or do nothing.

    ``overrides`` are the words of the command line. Neither they nor a file that they add, such as
    an experiment's, may add a key that nothing reads or change the type of a value. ``of_hydra``
    are the words that set Hydra itself. Must be called inside Hydra's application.
    """
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    groups = [override for override in parsed if _is_group(override)]
    before = _require_sound_files(groups, search_path(of_hydra))
    for override in parsed if cfg.task._target_ == PRETRAINING else ():
        if instead := INSTEAD.get(override.key_or_group):
            raise UserError(f"{override.key_or_group}: task=pretrain reads {instead} instead")
    for override in parsed:
        if override not in groups and not override.is_delete():
            key = override.key_or_group
            if override.is_add() and OmegaConf.select(before, key) is None:
                require_known(key, before)
            require_type(key, before, cfg)
    for key, least in AT_LEAST.items():
        value = OmegaConf.select(cfg, key)
        if value is not None and value < least:
            raise UserError(f"{key}: {value} is too small; give {least} or more")
    if cfg.optimizer.warmup > 1:
        raise UserError(f"optimizer.warmup: {cfg.optimizer.warmup} is no share; give 0 to 1")
    for key in LIMITS:
        if OmegaConf.select(cfg, key) == 0:
            raise UserError(f"{key}: 0 leaves nothing; give a number of batches, or a share")
    for key, choices in CHOICES.items():
        value = OmegaConf.select(cfg, key)
        if value not in choices:
            raise UserError(f"{key}: {value!r}; there are {', '.join(choices)}")
    require_rates(cfg.sim)
    history_stride(cfg.data.history_step_s, cfg.sim.capture_hz)
    _require_sizes(cfg)


def _require_sizes(cfg: DictConfig) -> None:
    """Grid and image fit the model, and the model's grid is the data set's, or on the ground."""
    grid = OmegaConf.to_container(cfg.grid, resolve=True)
    VoxelGrid(**grid)
    in_model = "model.decoder.grid" if cfg.model.ground is None else "model.ground.grid"
    for follower in ("sim.grid", in_model):
        for key, value in grid.items():
            if plain(OmegaConf.select(cfg, f"{follower}.{key}")) != value:
                raise UserError(f"{follower}.{key}: differs from grid.{key}; set grid.{key} alone")
    for side in ("width", "height"):
        value = cfg.sim.image[side]
        if value < 32 or value % 32:
            raise UserError(f"sim.image.{side}: {value} is not a multiple of 32; take one")
    _require_statistics(cfg)


def _require_statistics(cfg: DictConfig) -> None:
    """Batch normalisation in training wants more than one value a channel."""
    image = cfg.sim.image
    trains = cfg.task._target_ == TRAINING
    if trains and cfg.data.batch_size == 1 and image.width == image.height == 32:
        raise UserError(
            "data.batch_size: a single image of 32x32 pixels has one pixel in the deepest feature "
            "map, too few for batch normalisation; give 2 or more, or a larger sim.image"
        )


def _require_sound_files(groups: Sequence[Override], where: Sequence[str]) -> DictConfig:
    """The configuration of the chosen files, once those that may set any key, which are the scale's
    and the added ones, are found to set only keys that there are, to values of their type.

    ``where`` says in which folders there are more files.
    """
    words = [override.input_line for override in groups]
    composed = compose("config", [*words, *where], return_hydra_config=True)
    before = OmegaConf.masked_copy(composed, [key for key in composed if key != "hydra"])
    choices, there = composed.hydra.runtime.choices, _default_choices()
    files = {each.key_or_group: choices[each.key_or_group] for each in groups if each.is_add()}
    for group, choice in files.items():
        if group in before and group not in there:
            line = "# @package _global_"
            raise UserError(f"{group}={choice}: the file {choice}.yaml must begin with {line!r}")
    files["scale"] = choices["scale"]
    factors = [
        f"{'' if group in there else '+'}{group}={choice}"
        for group, choice in choices.items()
        if group not in files and not group.startswith("hydra/") and choice != there.get(group)
    ]
    told_by = ", ".join(f"{group}={choice}" for group, choice in files.items())
    require_set_soundly(compose("config", [*factors, *where]), before, told_by)
    return before


@cache
def _default_choices() -> dict[str, str]:
    """What is chosen of every group where nobody says anything."""
    return dict(compose("config", return_hydra_config=True).hydra.runtime.choices)


def _is_group(override: Override) -> bool:
    return (GROUPS / override.key_or_group).is_dir()
