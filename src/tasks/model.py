"""The configured model: built, and weighted by its training set."""

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..geometry import VoxelGrid
from ..metrics.suite import require_sound
from ..models.backbone import require_maps
from ..models.checkpoint import Origin
from ..models.ground import require_height
from ..models.history import PillarMemory
from ..models.module import OccupancyModule
from ..models.network import SkyOcc
from ..models.prior import VoxelPrior
from ..ontology import NUM_CLASSES
from ..run_folder import RunFolder, described
from .scoring import score_settings, suite_of


def origin_of(cfg: DictConfig, data: SkyShieldData, folder: RunFolder) -> Origin:
    """Returns the data that a new training starts from: configuration, code, counts and priors.

    Reads all training labels, for their counts and the priors, and the validation labels, on which
    the priors' weights of free are chosen. Raises `UserError` where there are none.
    """
    for part in ("train", "val"):
        data.dataset(part)  # for its refusal of a part without frames
    layers = [data.layer(*sample) for sample in data.split["train"]]
    by_voxel = VoxelPrior(data.grid.shape)
    by_height = VoxelPrior(data.grid.shape, (min(layers), max(layers)))
    # One pass over the labels serves both floors and the class counts.
    for semantics, _, layer in data.labels("train"):
        by_voxel.count(semantics)
        by_height.count(semantics, layer)

    scores = instantiate(cfg.metric)
    by_voxel.fit(((*labels[:2], 0) for labels in data.labels("val")), lambda: scores(data.grid))
    by_height.fit(data.labels("val"), lambda: scores(data.grid))

    return Origin(
        config=described(folder.config),
        code=folder.code,
        dataset=data.root.name,
        class_counts=by_voxel.counts.sum(dim=(1, 2, 3), dtype=torch.int64).tolist(),
        voxel_prior=by_voxel.labels(),
        height_prior=by_height.labels(),
        lowest_layer=min(layers),
    )


def network_of(cfg: DictConfig, origin: Origin) -> SkyOcc:
    """Builds a network to train, whose answers begin at the frequencies of the classes."""
    return instantiate(cfg.model, decoder={"class_prior": origin.class_counts})


def require_heights(network: SkyOcc, data: SkyShieldData) -> None:
    """Raises `UserError` for a clip that flies where the network cannot be asked."""
    for clip in data.clips.values():
        heights_m = clip.world_from_body[:, 2, 3]
        require_height(f"{clip.folder}/frames.csv", heights_m, network.heights_m)


def module_of(
    cfg: DictConfig, data: SkyShieldData, network: SkyOcc, origin: Origin
) -> OccupancyModule:
    """Joins a network with its loss and its scores.

    Raises `UserError` for data whose flights are not at the heights that the network knows.
    """
    require_heights(network, data)

    scores = instantiate(cfg.metric)
    # Only streams of consecutive frames have a history that earlier steps have computed.
    return OccupancyModule(
        network,
        instantiate(cfg.loss, class_counts=origin.class_counts),
        lambda: scores(data.grid),
        instantiate(cfg.optimizer),
        suite_of(cfg, data),
        PillarMemory(network.past_frames) if cfg.data.order == "streams" else None,
        origin,
    )


def require_buildable(cfg: DictConfig) -> None:
    """Builds the configured network, its loss, its scores and what makes its optimizer once and
    drops them, so that what is wrong with them is refused before any data are generated or read."""
    if cfg.model.sight is not None and "_target_" not in cfg.model.sight:
        raise UserError(
            "model/parallax: on, and model/sight=off; the depth of the pixels reads it: give both, "
            "or model/parallax=off"
        )

    if cfg.model.sight is not None and not cfg.data.pixels:
        raise UserError(
            "data.pixels: false, and model/sight=on learns from what pixels see; drop the key, "
            "or give model/sight=off"
        )

    # The weights of the network to train are drawn later, from an untouched generator.
    with torch.random.fork_rng(devices=[]):
        network = instantiate(cfg.model)
        require_maps(network.backbone)
        instantiate(cfg.loss, class_counts=[1] * NUM_CLASSES)
        instantiate(cfg.optimizer)

    if getattr(network, "parallax", None) is not None:
        network.parallax.strides(cfg.sim.capture_hz)
    grid = VoxelGrid(**OmegaConf.to_container(cfg.grid, resolve=True))
    require_sound(grid, score_settings(cfg)[1])
