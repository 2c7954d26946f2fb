"""task=generate: only the data set; with sim.dry_run=true only its plan and split."""

import math

import pandas as pd
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from ..sim.generate import frames_per_clip, plan_clips
from .dataset import make_dataset, root_of, spec_of, split_of

BYTES_PER_PIXEL = 0.45
BYTES_PER_VOXEL = 0.03
"""Measured: JPEG at quality 95, and both label arrays deflated."""


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
        size = frames * (
            pixels * BYTES_PER_PIXEL + math.prod(sim["grid"]["shape"]) * BYTES_PER_VOXEL
        )
        console.print(f"about {size / 2**30:.2f} GiB on disk")
        table = pd.DataFrame([vars(plan) for plan in plans])
        console.print(pd.crosstab(table["town"], table["weather"]).to_string())
        return
    made = make_dataset(cfg, root, spec_of(cfg))
    console.print(f"{root}: {len(plans)} clips, {made} of them made now")
