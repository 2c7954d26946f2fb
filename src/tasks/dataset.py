"""The dataset that a configuration names: found, made where clips are missing, never mixed."""

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from ..data import manifest
from ..data.rates import frames_per_clip
from ..data.shards import forget_shards, join_shards
from ..data.split import Split, make_split
from ..errors import UserError
from ..locks import locked, locked_if_free, telling


def spec_of(cfg: DictConfig) -> manifest.DatasetSpec:
    """Returns the dataset that the configuration asks for."""
    return manifest.DatasetSpec.of(cfg.scale_name, OmegaConf.to_container(cfg.sim, resolve=True))


def root_of(cfg: DictConfig) -> Path:
    """Returns ``paths.dataset``, or the folder that is named after all that shapes the data.

    Raises `UserError` for the key ``dataset``, of labels to score against, in its place.
    """
    if cfg.dataset is not None:
        raise UserError("dataset: names labels to score or to export; give paths.dataset=DIR here")
    return Path(cfg.paths.dataset or spec_of(cfg).root(Path(cfg.paths.data)))


def split_of(cfg: DictConfig, clip_ids: list[str]) -> Split:
    """Returns the temporal split of the configured clips."""
    return make_split(
        clip_ids,
        frames_per_clip(cfg.sim.capture_hz),
        cfg.sim.capture_hz,
        cfg.data.val_clips,
        cfg.data.test_clips,
    )


def finished_dataset(cfg: DictConfig) -> Path:
    """Returns the folder of a finished dataset, without generating anything.

    Raises `UserError` where there is none, and where it was made under other settings.
    """
    root = root_of(cfg)
    manifest.require_same_data(root, spec_of(cfg))
    return root


def ready_dataset(cfg: DictConfig) -> Path:
    """Makes what is missing and returns the dataset's folder: the first step of a training.

    A finished dataset needs no simulator. One that was made under another configuration is
    refused, and never added to; so is a request for a part of one.
    """
    root = root_of(cfg)
    # A manifest is written last, so clips are missing only where somebody has removed them.
    if (root / manifest.MANIFEST).is_file():
        finished_dataset(cfg)
        if not manifest.missing_clips(root, list(manifest.read_manifest(root)["clips"])):
            return root

    if cfg.sim.shards != 1:
        raise UserError(
            f"sim.shards: only task=generate makes one of {cfg.sim.shards} parts of a dataset; "
            "drop the key"
        )
    make_dataset(cfg)
    return root


def make_dataset(cfg: DictConfig) -> tuple[int, list[str]]:
    """Generates the missing clips of this shard, and finishes the dataset if it is the last.

    Returns how many clips were made, and which ones other shards have still to make. Raises
    `UserError` where ``paths.dataset`` names the folder: only a folder that is named after what
    shapes the data can be added to without mixing two datasets.
    """
    # Only here, because training on a finished dataset must not need the simulator.
    from ..sim.generate import LOCK, generate
    from ..sim.plan import plan_clips

    root, spec = root_of(cfg), spec_of(cfg)
    if cfg.paths.dataset:
        raise UserError(
            f"paths.dataset: {root} is no finished dataset; drop the key to generate one under "
            f"{cfg.paths.data}"
        )
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    clip_ids = [plan.clip_id for plan in plan_clips(sim)]
    split = split_of(cfg, clip_ids)
    # Before anything is made: shards of other settings would fill another folder.
    if sim["shards"] > 1 and manifest.missing_clips(root, clip_ids):
        join_shards(root.parent, spec, sim["shards"])

    made = generate(sim, root)
    # A shard that cannot have the lock leaves it to one that is still at work: that one looks for
    # missing clips when it is done, and finds none of this one's.
    is_shard, waited_for = sim["shards"] > 1, f"{root}: another process is finishing this dataset"
    lock = root / LOCK
    with locked_if_free(lock) if is_shard else locked(lock, telling(waited_for)) as is_free:
        # Another process may have made the last clips meanwhile, so what is missing is asked anew.
        missing = manifest.missing_clips(root, clip_ids)
        if not missing and (is_free or not is_shard):
            manifest.write_manifest(root, spec, clip_ids, split)
            forget_shards(root.parent, spec)
    return made, missing
