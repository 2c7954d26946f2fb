"""The data set that a configuration names: found, made where clips are missing, never mixed."""

from pathlib import Path

import lightning
from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..data.manifest import (
    MANIFEST,
    DatasetSpec,
    missing_clips,
    read_manifest,
    require_same_data,
    write_manifest,
)
from ..data.split import Split, make_split
from ..errors import UserError


def spec_of(cfg: DictConfig) -> DatasetSpec:
    """What the configuration asks for."""
    return DatasetSpec.of(cfg.scale_name, OmegaConf.to_container(cfg.sim, resolve=True))


def root_of(cfg: DictConfig) -> Path:
    """The data set's folder: ``paths.dataset``, or one named after all that shapes the data."""
    return Path(cfg.paths.dataset or spec_of(cfg).root(Path(cfg.paths.data)))


def split_of(cfg: DictConfig, clip_ids: list[str]) -> Split:
    """The temporal split of the configured clips."""
    from ..sim.generate import frames_per_clip

    return make_split(
        clip_ids,
        frames_per_clip(cfg.sim.capture_hz),
        cfg.sim.capture_hz,
        cfg.data.val_clips,
        cfg.data.test_clips,
    )


def ready_dataset(cfg: DictConfig) -> Path:
    """Makes what is missing and returns the data set's folder.

    A finished data set needs no simulator. One that was made under another configuration is
    refused, and never added to.
    """
    root, spec = root_of(cfg), spec_of(cfg)
    if (root / MANIFEST).is_file():
        require_same_data(root, spec)
        if not missing_clips(root, list(read_manifest(root)["clips"])):
            return root
    make_dataset(cfg, root, spec)
    return root


def make_dataset(cfg: DictConfig, root: Path, spec: DatasetSpec) -> int:
    """Generates missing clips, writes the manifest, and returns how many clips were made.

    Raises `UserError` where ``paths.dataset`` names the folder: only a folder that is named after
    what shapes the data can be added to without mixing two data sets.
    """
    # Only here, because training on a finished data set must not need the simulator.
    from ..sim.generate import generate, plan_clips

    if cfg.paths.dataset:
        raise UserError(
            f"paths.dataset: {root} is no finished data set; drop the key to generate one under "
            f"{cfg.paths.data}"
        )
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    clip_ids = [plan.clip_id for plan in plan_clips(sim)]
    split = split_of(cfg, clip_ids)
    made = generate(sim, root)
    write_manifest(root, spec, clip_ids, split)
    return made


def data_of(cfg: DictConfig, root: Path) -> SkyShieldData:
    """The loaders of a finished data set; seeds everything that training draws from."""
    lightning.seed_everything(cfg.seed, workers=True, verbose=False)
    return SkyShieldData(root, seed=cfg.seed, **OmegaConf.to_container(cfg.data, resolve=True))
