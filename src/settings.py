"""What a composed configuration must satisfy before any work starts."""

from pathlib import Path

from hydra import compose
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf

from .data.batches import ORDERS
from .data.dataset import HISTORY, history_stride
from .data.rates import require_rates
from .errors import UserError
from .failures import closest
from .geometry import VoxelGrid

GROUPS = Path(__file__).parent.parent / "conf"
INTEGER_OR_NULL = ("threads", "sim.workers")
UNION = ("trainer.devices",)
"""Settings of several types, which Lightning itself checks."""
ANY_LENGTH = ("suite.", "task.")
"""Where a list of numbers may be longer or shorter than the configuration's."""
NOT_EMPTY = ("suite.",)
"""Where it may not be empty then."""
TRAINING = "src.tasks.fit.fit"
PRECISIONS = ("auto", "32-true", "bf16-mixed", "16-mixed")
"""Geometry is computed in fp32, so the network has no pure half or double precision."""
CHOICES = {"trainer.precision": PRECISIONS, "data.order": ORDERS, "data.history": HISTORY}
UNITS = ("_m", "_s", "_hz", "_deg", "_mps")
"""Endings of quantities: any number will do, even where the configuration has a round one."""
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
    **dict.fromkeys(("task.epochs", "task.batch_size"), 1),
    "threads": 1,
}


def require_sound(cfg: DictConfig, overrides: list[str]) -> None:
    """Raises `UserError` that names the key, for what would otherwise fail late or do nothing.

    ``overrides`` are the words of the command line. They may not add a key that nothing reads, nor
    change the type of a value. Must be called inside Hydra's application.
    """
    parsed = OverridesParser.create().parse_overrides(overrides)
    groups = [override for override in parsed if _is_group(override)]
    before = compose("config", [override.input_line for override in groups])
    for override in parsed:
        if override not in groups and not override.is_delete():
            _require_known(override, before)
            _require_type(override.key_or_group, before, cfg)
    for key, least in AT_LEAST.items():
        value = OmegaConf.select(cfg, key)
        if value is not None and value < least:
            raise UserError(f"{key}: {value} is too small; give {least} or more")
    for key, choices in CHOICES.items():
        value = OmegaConf.select(cfg, key)
        if value not in choices:
            raise UserError(f"{key}: {value!r}; there are {', '.join(choices)}")
    require_rates(cfg.sim)
    history_stride(cfg.data.history_step_s, cfg.sim.capture_hz)
    _require_sizes(cfg)


def _require_known(override: Override, before: DictConfig) -> None:
    """A key may be added where a class takes it as an argument, and nowhere else."""
    if not override.is_add() or OmegaConf.select(before, override.key_or_group) is not None:
        return
    parent, _, name = override.key_or_group.rpartition(".")
    node = OmegaConf.select(before, parent) if parent else before
    takes_arguments = isinstance(node, DictConfig) and (not node or "_target_" in node)
    if not takes_arguments:
        known = list(map(str, node)) if isinstance(node, DictConfig) else []
        raise UserError(
            f"{override.key_or_group}: nothing reads this key{closest(name, known)} "
            f"there are {', '.join(known)}"
        )


def _require_type(key: str, before: DictConfig, cfg: DictConfig) -> None:
    was, now = (_plain(OmegaConf.select(node, key)) for node in (before, cfg))
    if key in UNION or (now is None and (was is None or key.startswith("trainer."))):
        return
    if key in INTEGER_OR_NULL:
        was = 1
    elif key.endswith(UNITS) and isinstance(was, int):
        was = float(was)
    both_lists = isinstance(was, list) and isinstance(now, list)
    if both_lists and key.startswith(ANY_LENGTH) and (now or not key.startswith(NOT_EMPTY)):
        was = was[:1] * len(now)
    wanted = _mismatch(was, now)
    if wanted:
        raise UserError(f"{key}: {now!r} is not {wanted}; the configuration has {was!r}")


def _mismatch(was: object, now: object) -> str | None:
    """What a value should have been, or ``None`` where it is of the right type."""
    if isinstance(was, bool):
        return None if isinstance(now, bool) else "true or false"
    if isinstance(was, int | float):
        kinds = int if isinstance(was, int) else int | float
        ok = isinstance(now, kinds) and not isinstance(now, bool)
        return None if ok else ("an integer" if kinds is int else "a number")
    if isinstance(was, dict):
        return None if isinstance(now, dict) else "a group of keys"
    if isinstance(was, list):
        if not isinstance(now, list):
            return "a list"
        if was and all(isinstance(item, int | float) for item in was):
            same = len(now) == len(was) and not any(map(_mismatch, was, now))
            return None if same else f"a list of {len(was)} numbers of that type"
    if isinstance(was, str) and isinstance(now, dict | list | None):
        return "a word"
    return None


def _require_sizes(cfg: DictConfig) -> None:
    """Grid and image fit the model, and the model's grid is the data set's, or on the ground."""
    grid = OmegaConf.to_container(cfg.grid, resolve=True)
    VoxelGrid(**grid)
    in_model = "model.decoder.grid" if cfg.model.ground is None else "model.ground.grid"
    for follower in ("sim.grid", in_model):
        for key, value in grid.items():
            if _plain(OmegaConf.select(cfg, f"{follower}.{key}")) != value:
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


def _is_group(override: Override) -> bool:
    return (GROUPS / override.key_or_group).is_dir()


def _plain(node: object) -> object:
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node
