"""Values that no class of this project checks itself: refused before any work begins."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from .data.batches import ORDERS
from .data.clip import CLIP_SECONDS
from .data.dataset import HISTORY, history_stride
from .data.rates import require_rates
from .errors import UserError
from .geometry import VoxelGrid
from .limits import require_at_least, require_choice, require_count
from .run_folder import ANCHORS, ASIDE, REPORT

TRAINING = "src.tasks.fit.fit"
LONGEST_NAME = 200
LARGEST_SEED = 2**32 - 1  # numpy's
# Geometry is computed in fp32, so the network has no pure half or double precision.
PRECISIONS = ("32-true", "bf16-mixed", "16-mixed")
CHOICES = {
    "trainer.precision": ("auto", *PRECISIONS),
    "gpu_precision": PRECISIONS,
    "data.order": ORDERS,
    "data.history": HISTORY,
}
AT_LEAST = (
    (0, "sim", ("seed",)),
    (0, "optimizer", ("lr", "weight_decay", "warmup")),
    (1, "trainer", ("max_epochs", "accumulate_grad_batches")),
    (0, "trainer", ("gradient_clip_val",)),
    (-1, "trainer", ("num_sanity_val_steps",)),  # -1: of all batches
    (1, "data", ("batch_size", "frames", "run_frames")),
    (0, "data", ("workers",)),
    (1, "size", ("backbone_width", "dim", "layers", "heads", "heights", "points")),
    (0, "size", ("blocks",)),
    (1, "model.encoder", ("num_layers", "num_heights", "num_heads")),
    (0, "model.decoder", ("num_blocks",)),
    (1, "model.sight", ("bins",)),
    (0, "model.sight", ("weight",)),
)
# An argument of a class of ours that is another key's value, and the key to set.
OURS = ("encoder.PillarEncoder", "decoder.PillarDecoder", "sight.SightHead")
SAME = {
    "model.encoder.num_frames": "data.frames",
    "model.encoder.dim": "size.dim",
    "model.decoder.dim": "size.dim",
    "model.sight.dim": "size.dim",
}
# Keys that another one, or the program itself, sets.
SET_ELSEWHERE = {
    "optimizer.rule.lr": "give optimizer.lr",
    "optimizer.rule.weight_decay": "give optimizer.weight_decay",
    "optimizer.rule.params": "it gets those of the network; drop the key",
    "trainer.logger": "give logger=csv, or a file in conf/logger",
    "trainer.callbacks": "give +callbacks.NAME._target_=CLASS",
}
# What keeps the best and the last weights of a training in their files, where it is given. Of
# batches Lightning counts an integer, and takes a share of a float.
CHECKPOINTS = {
    **{f"callbacks.{name}.dirpath": "${paths.run}/checkpoints" for name in ("best", "last")},
    **{f"callbacks.{name}.filename": name for name in ("best", "last")},
    **{f"callbacks.{name}.save_top_k": 1 for name in ("best", "last")},
    "trainer.fast_dev_run": False,
    "trainer.val_check_interval": 1.0,
    "trainer.enable_checkpointing": True,
}
# For whom another key does what they want.
INSTEAD = {
    "trainer.fast_dev_run": ", or give +debug=fast",
    "trainer.val_check_interval": ", or give shorter epochs: +trainer.limit_train_batches=0.5",
}


def require_values(cfg: DictConfig) -> None:
    """Raises `UserError` that names the key, for a value that would fail late or do nothing."""
    _require_name(cfg)
    if not 0 <= cfg.seed <= LARGEST_SEED:
        raise UserError(f"seed: {cfg.seed} is out of range; give 0 to {LARGEST_SEED}")

    for least, group, names in AT_LEAST:
        require_at_least(least, group, OmegaConf.select(cfg, group) or {}, *names)
    for key, choices in CHOICES.items():
        require_choice(key, OmegaConf.select(cfg, key), choices)
    for key in ("threads", "sim.workers"):
        require_count(key, OmegaConf.select(cfg, key))

    require_rates(cfg.sim)
    _require_shared(cfg)
    _require_past(cfg)
    _require_training(cfg)
    _require_grids(cfg)
    _require_image(cfg)


def _require_name(cfg: DictConfig) -> None:
    """Checks the names of the run and of its group, which are those of folders."""
    if not isinstance(cfg.name, str):
        raise UserError(f"name: {cfg.name!r} is no word; quote it twice: 'name=\"{cfg.name}\"'")

    # Or the run's folder would lie elsewhere, or be that of all runs of the scale.
    if not cfg.name or cfg.name.startswith(".") or {"/", "\\"} & {*cfg.name}:
        raise UserError(
            f"name: {cfg.name!r} is no name of a folder; give one without slashes that does not "
            "begin with a dot"
        )

    # Files are called by it, with other words around.
    if len(cfg.name.encode()) > LONGEST_NAME:
        raise UserError(f"name: of {len(cfg.name.encode())} bytes; give one of {LONGEST_NAME}")
    if cfg.name in ANCHORS:
        raise UserError(f"name: {cfg.name!r} is that of an anchor, scored beside every run")

    group = Path(str(cfg.group))
    if not group.name or group.is_absolute() or ".." in group.parts:
        raise UserError(f"group: {cfg.group!r} is no folder below paths.runs; give a name")
    if cfg.name == REPORT or ASIDE.search(cfg.name):
        raise UserError(f"name: {cfg.name!r} is that of a folder which is no run; give another")


def _require_shared(cfg: DictConfig) -> None:
    """Checks values that another key sets."""
    for key, source in SAME.items():
        value, wanted = OmegaConf.select(cfg, key), OmegaConf.select(cfg, source)
        target = str(OmegaConf.select(cfg, f"{key.rpartition('.')[0]}._target_"))
        if target.removeprefix("src.models.") in OURS and value != wanted:
            raise UserError(f"{key}: {value}, and {source} is {wanted}; set {source} alone")
    for key, way_out in SET_ELSEWHERE.items():
        group, _, name = key.rpartition(".")
        if name in (OmegaConf.select(cfg, group) or {}):
            raise UserError(f"{key}: nothing reads it; {way_out}")


def _require_past(cfg: DictConfig) -> None:
    """Checks how far back frames and images of the past lie."""
    data = cfg.data
    history_stride(data.history_step_s, cfg.sim.capture_hz)

    if data.order == "streams":
        if data.frames == 1:
            raise UserError(
                "data.order: streams keep a past, and data.frames=1 has none; give 2 or more"
            )
        if cfg.model.get("history_grad"):
            raise UserError(
                "model.history_grad: true, and with data.order=streams the past was computed in "
                "earlier steps; drop one of them"
            )

    ages_s = OmegaConf.select(cfg, "data.parallax.ages_s") or []
    if beyond := [age_s for age_s in ages_s if age_s >= CLIP_SECONDS]:
        raise UserError(
            f"data.parallax.ages_s: {beyond[0]} s is further back than a clip of {CLIP_SECONDS:g} "
            "s goes; give less"
        )


def _require_training(cfg: DictConfig) -> None:
    """Checks how the optimizer and the trainer are set, and a training's callbacks and labels."""
    if cfg.optimizer.warmup > 1:
        raise UserError(f"optimizer.warmup: {cfg.optimizer.warmup} is no share; give 0 to 1")
    for part in ("train", "val", "test"):
        key = f"trainer.limit_{part}_batches"
        value = OmegaConf.select(cfg, key)
        if value is not None and not (isinstance(value, int | float) and value > 0):
            raise UserError(f"{key}: {value!r}; give a number of batches above 0, or a share")
    if Path(cfg.trainer.default_root_dir or "") == Path(cfg.paths.run):
        raise UserError(
            "trainer.default_root_dir: is the run's own folder, whose weights Lightning would take "
            "for its own under Slurm; give another one"
        )
    if "spawn" in str(cfg.trainer.strategy):
        raise UserError(
            f"trainer.strategy: {cfg.trainer.strategy} would have to pickle the run; give ddp"
        )
    if cfg.task._target_ != TRAINING:
        return

    if lacking := {"best", "last"}.difference(cfg.callbacks):
        raise UserError(f"callbacks.{min(lacking)}: a training needs it, and it is not there")
    for key, wanted in CHECKPOINTS.items():
        value = OmegaConf.select(cfg, key)
        wanted = wanted.replace("${paths.run}", cfg.paths.run) if type(wanted) is str else wanted
        if value is not None and (type(value), value) != (type(wanted), wanted):
            raise UserError(
                f"{key}: {value}; a training goes on from its last epoch and is scored with its "
                f"best, which wants {wanted}; drop the key{INSTEAD.get(key, '')}"
            )
    if cfg.trainer.max_epochs is None:
        raise UserError("trainer.max_epochs: null; the schedule wants a number, 1 or more")
    every = OmegaConf.select(cfg, "trainer.check_val_every_n_epoch", default=1)
    require_count("trainer.check_val_every_n_epoch", every)
    if every is None or every > cfg.trainer.max_epochs:
        raise UserError(
            f"trainer.check_val_every_n_epoch: {every}, and there are trainer.max_epochs="
            f"{cfg.trainer.max_epochs}; the best is chosen on validation: give fewer"
        )
    if cfg.data.pixels and not (cfg.sim.save_aux or cfg.paths.dataset):
        raise UserError(
            "sim.save_aux: false, and model/sight=on learns from what pixels see; drop the key, or "
            "give model/sight=off model/parallax=off model/evidence=off"
        )


def _require_grids(cfg: DictConfig) -> None:
    """Checks the grid, which the dataset has as well, and the model or its volume on the ground."""
    grid = OmegaConf.to_container(cfg.grid, resolve=True)
    VoxelGrid(**grid)
    of_model = "model.decoder.grid" if cfg.model.ground is None else "model.ground.grid"
    for follower in ("sim.grid", of_model):
        for key, value in grid.items():
            if OmegaConf.select(cfg, f"{follower}.{key}") != value:
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
