"""task=generate: only the data set; with sim.dry_run=true only its plan and split."""

import math

import pandas as pd
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from ..data.rates import frames_per_clip
from ..sim.plan import plan_clips
from .dataset import make_dataset, root_of, spec_of, split_of

BYTES_PER_PIXEL = 0.76
BYTES_PER_VOXEL = 0.076
BYTES_PER_FRAME = 8_600
"""Of the image, both label arrays and the tables, measured on the data set of scale=small."""


def generate(cfg: DictConfig) -> None:
    """Makes the clips that are missing, or prints what there is to make."""
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    plans = plan_clips(sim)
    split = split_of(cfg, [plan.clip_id for plan in plans])
    root, console = root_of(cfg), Console()
    if sim["dry_run"]:
        frames = frames_per_clip(sim["capture_hz"]) * len(plans)
        console.print(f"{root}: {len(plans)} clips, {frames} frames")
        console.print(" / ".join(f"{part} {len(samples)}" for part, samples in split.items()))
        pixels = sim["image"]["width"] * sim["image"]["height"]
        voxels = math.prod(sim["grid"]["shape"])
        size = pixels * BYTES_PER_PIXEL + voxels * BYTES_PER_VOXEL + BYTES_PER_FRAME
        console.print(f"about {frames * size / 2**20:.0f} MiB on disk")
        table = pd.DataFrame([vars(plan) for plan in plans])
        console.print(pd.crosstab(table["town"], table["weather"]).to_string())
        return
    made, missing = make_dataset(cfg, root, spec_of(cfg))
    share = f"shard {sim['shard']} of {sim['shards']}, " if sim["shards"] > 1 else ""
    state = f"{len(missing)} still to be made by other shards" if missing else "all there"
    console.print(f"{root}: {share}{made} clips made now; of {len(plans)} clips {state}")
