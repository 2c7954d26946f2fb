"""The configured model: built, weighted by its training set, and filled from a checkpoint."""

import pickle
from pathlib import Path

import torch
import yaml
from hydra.errors import HydraException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from torch import Tensor, nn

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..geometry import VoxelGrid
from ..metrics.suite import ScoreSuite
from ..models.memory import PillarMemory
from ..models.module import OccupancyModule
from ..models.network import SkyOcc
from ..models.prior import VoxelPrior
from ..ontology import FREE, NUM_CLASSES
from ..run_folder import CONFIG, RunFolder
from .scoring import score_settings, suite_of


def prior_of(cfg: DictConfig, data: SkyShieldData) -> VoxelPrior:
    """The voxel prior of the training labels, its weight of free chosen on validation."""
    prior = VoxelPrior(data.grid.shape, NUM_CLASSES, FREE)
    for semantics, _ in data.labels("train"):
        prior.count(semantics)
    scores = instantiate(cfg.metric)
    frames = ((labels[None], velocity[None]) for labels, velocity in data.labels("val"))
    prior.fit(frames, lambda: scores(data.grid))
    return prior


def module_of(cfg: DictConfig, data: SkyShieldData, prior: VoxelPrior) -> OccupancyModule:
    """The network, its loss and its scores. Class counts come from the training set."""
    counts = prior.counts.sum(dim=(1, 2, 3), dtype=torch.int64)
    network = instantiate(cfg.model, decoder={"class_prior": counts.tolist()})
    loss = instantiate(cfg.loss)
    rule = loss.keywords["class_weights"]
    scores = instantiate(cfg.metric)
    return OccupancyModule(
        network,
        loss(class_weights=None if rule is None else rule(counts)),
        lambda: scores(data.grid),
        cfg.optimizer,
        suite_of(cfg, data),
        PillarMemory(network.past_frames) if cfg.data.order == "streams" else None,
    )


def from_checkpoint(cfg: DictConfig) -> DictConfig:
    """The configuration of a network that a checkpoint will fill: the file that its training began
    with need not be there any more."""
    cfg = cfg.copy()
    if "weights" in cfg.model.backbone:
        cfg.model.backbone.weights = None
    return cfg


def require_buildable(cfg: DictConfig) -> None:
    """Builds the configured network and its scores once and drops them: what is wrong with them is
    said before any data are generated or read."""
    with torch.random.fork_rng(devices=[]):
        instantiate(cfg.model)
    grid = VoxelGrid(**OmegaConf.to_container(cfg.grid, resolve=True))
    ScoreSuite(grid, [], *score_settings(cfg))


def load_weights(module: nn.Module, path: Path) -> None:
    """Fills a module from a checkpoint file.

    Raises `UserError` for a file that is no checkpoint, or one of another architecture.
    """
    state = _state_of(path)
    own = module.state_dict()
    strange = [
        name
        for name in sorted(own.keys() | state.keys())
        if name not in own or name not in state or own[name].shape != state[name].shape
    ]
    if strange:
        raise UserError(
            f"ckpt_path: {path} is of another architecture ({len(strange)} parameters differ, "
            f"{strange[0]} first); use the model and scale of the config.yaml beside it"
        )
    module.load_state_dict(state)


def network_of_run(run: str | Path, checkpoint: str = "best") -> SkyOcc:
    """The trained network of a run folder, by its ``config.yaml``: for flying, without any data.

    ``checkpoint`` is ``best``, ``last`` or a file. Raises `UserError` for a folder without them, or
    for weights of another architecture.
    """
    path = Path(run) / CONFIG
    try:
        cfg = OmegaConf.create(yaml.safe_load(path.read_text()))
        network = instantiate(from_checkpoint(cfg).model)
    except (OSError, yaml.YAMLError, HydraException, OmegaConfBaseException) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: cannot be read ({reason}); name a folder of a run") from error
    file = RunFolder(Path(run), OmegaConf.to_container(cfg)).checkpoint(checkpoint)
    load_weights(nn.ModuleDict({"network": network}), file)
    return network.eval()


def _state_of(path: Path) -> dict[str, Tensor]:
    try:
        return torch.load(path, map_location="cpu", weights_only=True)["state_dict"]
    except (KeyError, TypeError, EOFError, OSError, RuntimeError, pickle.UnpicklingError) as error:
        reason = " ".join(str(error).split())[:120]
        raise UserError(
            f"ckpt_path: {path} is no readable checkpoint ({reason}); give another one, or delete "
            "it to start anew"
        ) from error
