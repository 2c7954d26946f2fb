"""task=fit: generate what is missing, train, test the best checkpoint, write what came out."""

from pathlib import Path

from omegaconf import DictConfig

from ..errors import UserError
from ..limits import require_choice
from ..models.checkpoint import Checkpoint, load_weights
from ..models.module import OccupancyModule
from ..models.weights import require_unseen
from ..ontology import CLASSES
from ..run_folder import described, require_same_config
from ..terminal import say
from ..used_code import different_file
from .dataset import root_of
from .evaluate import evaluate, show
from .model import module_of, network_of, origin_of, require_buildable
from .session import Session
from .stages import announce, stages_of_training
from .trainer import is_first_process

SKIPPED = "already finished, skipped"


def fit(cfg: DictConfig) -> str:
    """Trains the configured model and leaves its run folder complete; returns how that went.

    A finished run of the same configuration and code is shown again, a half-done one goes on from
    its last checkpoint, and anything else in its place is moved aside.
    """
    session = Session(cfg, generates=True)
    if _shown_again(session):
        return SKIPPED

    # What cannot be done is refused here, in order of cost, before anything is made or moved aside.
    _ = session.trainer  # for its refusal of a device or a precision
    named = None if cfg.ckpt_path is None else _checkpoint_to_resume(session)
    require_buildable(cfg)
    _announce_stages(session, named)
    begun_with, sim = cfg.model.backbone.get("weights"), session.folder.config["sim"]
    require_unseen(begun_with, session.data.root.name, sim, cfg.data.test_clips)
    session.data.require_pixels()

    # The other processes of a run would wait for the lock of the first one.
    if not is_first_process():
        return _train(session, named)
    with session.folder.alone():
        # A process that was waited for may have finished the run.
        return SKIPPED if _shown_again(session) else _train(session, named)


def _shown_again(session: Session) -> bool:
    """Prints the results and returns true, where the run is finished and shall not be repeated."""
    cfg, folder = session.cfg, session.folder
    if not folder.is_finished() or cfg.overwrite or cfg.ckpt_path is not None:
        return False
    say(f"{folder.path}: already finished; overwrite=true trains it again")
    show(folder, cfg)
    return True


def _train(session: Session, named: Path | None) -> str:
    """Trains from the checkpoint ``named``, the last one, or anew, and scores the best."""
    cfg, folder = session.cfg, session.folder
    path = named or folder.to_resume(afresh=cfg.overwrite)

    # A broken checkpoint is refused here, in one line.
    checkpoint = None if path is None else Checkpoint.read(path)
    module = _module(session, checkpoint)
    # Callbacks of one's own may log what they like.
    own = {*cfg.callbacks} - {"best", "last", "progress", "preview"}
    if (monitor := cfg.callbacks.best.get("monitor")) and not own:
        require_choice("callbacks.best.monitor", monitor, module.monitored())
    done = f"epoch {checkpoint.epochs} of {cfg.trainer.max_epochs}" if checkpoint else ""

    # Nothing is left to refuse: now what is in the way of this run may move aside.
    if is_first_process():
        if named is None:
            folder.open(afresh=cfg.overwrite)
        if (weights := module.loss.class_weights) is not None:
            folder.write_json("class_weights.json", dict(zip(CLASSES, weights.tolist())))
        _announce(session, module, done)
    try:
        session.trainer.fit(module, datamodule=session.data, ckpt_path=path, weights_only=True)
    finally:
        if is_first_process():
            folder.merge_metrics()

    if not folder.best_checkpoint.is_file():
        raise UserError(
            f"{folder.path}: has no best.ckpt, as no validation was reached or callbacks.best kept "
            "none; give trainer.max_epochs, and no max_steps or max_time within the first epoch"
        )
    # The best epoch by validation is scored; the last one stays, to go on from.
    load_weights(module, Checkpoint.read(folder.best_checkpoint).state, folder.best_checkpoint)
    evaluate(session, module, folder)
    return f"finished, went on after {done}" if done else "finished"


def _announce_stages(session: Session, named: Path | None) -> None:
    """Prints what is to be done and about how long it takes, before any of it begins."""
    cfg, folder = session.cfg, session.folder
    if not is_first_process():
        return
    path = named or folder.to_resume(afresh=cfg.overwrite)
    epochs_done = 0 if path is None else Checkpoint.read(path).epochs
    announce(f"{_called(cfg)}, in {folder.path}", stages_of_training(cfg, epochs_done))


def _called(cfg: DictConfig) -> str:
    return f"{cfg.name}, recipe {cfg.recipe_name}, scale {cfg.scale_name}, seed {cfg.seed}"


def _module(session: Session, checkpoint: Checkpoint | None) -> OccupancyModule:
    """Builds the module to train; one that goes on from a checkpoint reads no training label."""
    cfg, data = session.cfg, session.data
    origin = checkpoint.origin if checkpoint else origin_of(cfg, data, session.folder)
    module = module_of(cfg, data, network_of(cfg, origin), origin)
    if checkpoint:
        load_weights(module, checkpoint.state, checkpoint.path)
    return module


def _checkpoint_to_resume(session: Session) -> Path:
    """Returns the checkpoint that ``ckpt_path`` names; refuses one of another run, of another
    configuration, of another dataset or of other code."""
    folder, cfg = session.folder, session.cfg
    path = folder.checkpoint(cfg.ckpt_path)
    origin = Checkpoint.read(path).origin
    require_same_config(path, origin.config, described(folder.config))

    # To go on here would split one training over two folders.
    if path.resolve().parent != folder.last_checkpoint.resolve().parent:
        raise UserError(
            f"ckpt_path: {path} belongs to another run than {folder.path}; set paths.run to its "
            "folder to go on with it, or task=test to score it"
        )
    if origin.dataset != (name := root_of(cfg).name):
        raise UserError(
            f"ckpt_path: {path} was trained on {origin.dataset}, and now the data are {name}; give "
            "those, or drop ckpt_path to start anew"
        )
    if file := different_file(origin.code, folder.code):
        raise UserError(
            f"ckpt_path: {path} was trained by other code: {file} differs; go on in a checkout "
            "of that code, or drop ckpt_path to start anew"
        )
    return path


def _announce(session: Session, module: OccupancyModule, done: str) -> None:
    """Prints in two lines what is about to be trained, and how."""
    cfg, data, trainer = session.cfg, session.data, session.trainer
    parameters = sum(p.numel() for p in module.network.parameters())
    frames = " / ".join(str(len(samples)) for samples in data.split.values())
    schedule = f"goes on after {done}" if done else f"{cfg.trainer.max_epochs} epochs"
    say(
        f"{_called(cfg)}: {parameters / 1e6:.2f} M parameters on {trainer.strategy.root_device} "
        f"in {trainer.precision}, {schedule}"
    )
    say(f"{data.root}: {frames} frames to train / validate / test")
