"""task=generate: only the dataset; with sim.dry_run=true only its plan, split, size and time."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig, OmegaConf

from ..data.manifest import MANIFEST, read_manifest
from ..data.rates import frames_per_clip
from ..sim.clip_maker import ClipPlan
from ..sim.plan import plan_clips
from ..terminal import duration, say
from ..worker_pool import default_workers
from .dataset import make_dataset, root_of, split_of
from .stages import cores, generation_s, work_of

# Of the image, both label arrays and the tables, measured on the dataset of scale=small.
BYTES = {"pixel": 0.76, "voxel": 0.076, "frame": 8_600}


def generate(cfg: DictConfig) -> None:
    """Makes the clips that are missing, or prints what there is to make."""
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    plans, root = plan_clips(sim), root_of(cfg)
    split = split_of(cfg, [plan.clip_id for plan in plans])

    if sim["dry_run"]:
        frames = frames_per_clip(sim["capture_hz"]) * len(plans)
        say(f"{root}: {len(plans)} clips, {frames:,} frames")
        say(" / ".join(f"{part} {len(samples):,}" for part, samples in split.items()))
        say(_effort(sim, len(plans)))
        say(_matrix(sim, plans).to_string())
        for line in _others(root):
            say(line)
        return

    made, missing = make_dataset(cfg)
    share = f"shard {sim['shard']} of {sim['shards']}, " if sim["shards"] > 1 else ""
    state = f"{len(missing)} still to be made by other shards" if missing else "all there"
    say(f"{root}: {share}{made} clips made now; of {len(plans)} clips {state}")


def _others(root: Path) -> Iterator[str]:
    """Yields what the other finished datasets beside this one are: their names are hashes."""
    for path in sorted(root.parent.glob(f"*/{MANIFEST}")):
        if path.parent == root:
            continue
        manifest = read_manifest(path.parent)
        sim, clips = manifest["sim"], manifest["clips"]
        # What was recorded elsewhere has no seed.
        towns = ", ".join(dict.fromkeys(clip.partition("/")[0] for clip in clips))
        seed = f", seed {sim['seed']}" if "seed" in sim else ""
        image, shape = sim["image"], "x".join(map(str, sim["grid"]["shape"]))
        yield (
            f"also there: {path.parent}: {len(clips)} clips in {towns}{seed}, "
            f"{image['width']}x{image['height']} pixels, {shape} voxels"
        )


def _matrix(sim: Mapping, plans: Sequence[ClipPlan]) -> pd.DataFrame:
    """Counts clips by town and weather, in the order of the settings, with sums."""
    table = pd.DataFrame([vars(plan) for plan in plans])
    counts = pd.crosstab(table["town"], table["weather"], margins=True, margins_name="all")
    towns, weathers = ([*sim[key], "all"] for key in ("towns", "weathers"))
    counts = counts.reindex(index=towns, columns=weathers, fill_value=0)
    return counts.rename_axis(index=None, columns=None)


def _effort(sim: Mapping, clips: int) -> str:
    """Estimates disk and time from measured costs of a pixel, a voxel, a frame and so on."""
    counts, workers = work_of(sim, clips), sim["workers"] or default_workers()
    size_mib = sum(counts[unit] * cost for unit, cost in BYTES.items()) / 2**20
    time = duration(generation_s(sim, clips))
    return f"about {size_mib:,.0f} MiB on disk, and {time} on {cores(workers)}"
