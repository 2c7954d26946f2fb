"""Run folders of a ladder as training leaves them, with random predictions for its networks."""

from dataclasses import replace
from functools import cache, partial

import torch
import yaml
from omegaconf import OmegaConf

from src.geometry import VoxelGrid
from src.metrics.protocol import SUPERVISED, Protocol
from src.metrics.suite import ScoreSuite
from src.results.counts import Counts, parts_of
from src.results.files import result_rows, write_results
from src.results.runs import read_run
from src.run_folder import ANCHORS, NO_RECIPE
from tests.metrics.inputs import with_metrics

GRID = VoxelGrid((0.0, -10.0, -6.0), (24.0, 10.0, 6.0), (6, 5, 3))
CLIPS = [f"town/clip{n:02d}" for n in range(6)]
UNSEEN = CLIPS[4:]
FRAMES = [1, 1, 1, 1, 3, 0]
"""Of every clip; the last one is in no part."""
METRIC = {
    **{"num_classes": 9, "free_index": 8, "ignore_index": 255},
    **{"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0},
}
SUITE = {
    **{"ttc_edges_s": [1.0, 5.0], "distance_edges_m": [5.0, 10.0]},
    **{"tube_radius_m": 3.0, "tube_s": 2.0, "thin_tolerance": 1, "calibration_bins": 5},
    **{"turns_deg_per_s": [-30, 0, 30], "climbs_deg": [0, 10], "phantoms": 0.01},
    **{"collision": 2.0, "object_near_m": 4.0, "object_s": 2.0, "object_tolerance_m": 0.5},
    **{"ray_thresholds_m": [1.0, 4.0], "rays": [6, 4]},
    **{"resamples": 60, "level": 0.9, "seed": 0},
}
WEIGHTS = {"_target_": "src.models.losses.safety_weights", "_partial_": True, "max_ratio": 4.0}
FACTORS = {
    "baseline": ("level", None, 0.0),
    "attitude": ("attitude", None, 0.0),
    "weights": ("attitude", WEIGHTS, 0.0),
    "skyocc": ("attitude", WEIGHTS, 1.0),
}
RIGHT = {"baseline": 0.3, "attitude": 0.4, "weights": 0.5, "skyocc": 0.6}
"""Share of the voxels that a rung predicts as they are."""


@cache
def protocol(dataset="tiny-0123", **metric):
    frames = sum(FRAMES)
    metric = METRIC | metric
    suite = with_metrics(metric, SUITE)
    return Protocol.of(dataset, "test", frames, GRID, SUPERVISED, metric, suite)


def truth(frames, seed):
    rng = torch.Generator().manual_seed(seed)
    size = (frames, *GRID.shape)
    target = torch.randint(0, 13, size, generator=rng).clamp(max=8)
    return target.masked_fill(torch.rand(size, generator=rng) < 0.1, 255).to(torch.uint8)


def predicted(target, right, seed):
    """The truth in a share of the voxels, and anything elsewhere."""
    rng = torch.Generator().manual_seed(seed)
    other = torch.randint(0, 9, target.shape, generator=rng).to(torch.uint8)
    kept = (torch.rand(target.shape, generator=rng) < right) & (target != 255)
    return torch.where(kept, target, other)


def scene_of(target, clip, cameras=True):
    """The ground truth of a clip, which flies ahead; a level camera sees it."""
    frames = len(target)
    scene = {"clip": [clip] * frames, "semantics": target, "visible": target < 4}
    scene["velocity_mps"] = torch.tensor([[4.0, 0.5, 0.0]]).expand(frames, 3)
    if cameras:
        level = torch.tensor([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
        lens = torch.tensor([[32.0, 0, 32], [0, 32, 16], [0, 0, 1]])
        scene["camera_from_occ"] = level.expand(frames, 4, 4)
        scene["pix_from_camera"] = lens.expand(frames, 3, 3)
        scene["size_pix"] = (64, 32)
    return scene


def counts(name, predict, labels=0, of=None, cameras=True, frames_of=FRAMES):
    """What ``predict(target, clip number)`` counts on every clip."""
    of = of or protocol()
    suite = ScoreSuite.of(of, CLIPS)
    for n, (clip, frames) in enumerate(zip(CLIPS, frames_of)):
        if not frames:
            continue
        target = truth(frames, seed=100 * labels + n)
        suite.update(predict(target, n), scene_of(target, clip, cameras))
    return Counts(name, of, CLIPS, frames_of, suite.counts())


def counts_by_seed(rights):
    """Counts of experiments by seed: ``rights`` are the shares of the voxels that they get right,
    and elsewhere every seed guesses otherwise."""
    made = {}
    for name, by_seed in rights.items():
        for seed, right in by_seed.items():
            guess = partial(_guess, right=right, first=50 * seed)
            made.setdefault(name, {})[seed] = counts(name, guess)
    return made


def _guess(target, n, right, first):
    return predicted(target, right, first + n)


def config_of(experiment, seed, **changes):
    """What a report reads of a composed configuration, and some more; ``a__b`` is ``a.b``."""
    factors = FACTORS.get(experiment, FACTORS["skyocc"])
    config = {
        "name": experiment,
        "seed": seed,
        "paths": {"run": f"runs/tiny/{experiment}/seed{seed}"},
        "optimizer": {"lr": 0.002, "weight_decay": 0.01, "warmup": 0.05}
        | {"rule": {"_target_": "torch.optim.AdamW"}},
        "data": {"test_clips": UNSEEN, "frames": 4, "order": "shuffled", "mirror": True}
        | {"batch_size": 8, "workers": seed},
        "model": {"encoder": {"projection": factors[0]}},
        "loss": {"class_weights": factors[1], "lovasz_weight": factors[2]},
        "trainer": {"max_epochs": 8, "devices": 1, "accumulate_grad_batches": 1}
        | {"default_root_dir": f"runs/tiny/{experiment}/seed{seed}"},
    }
    config = OmegaConf.create(config)
    for key, value in changes.items():
        OmegaConf.update(config, key.replace("__", "."), value, merge=False)
    return OmegaConf.to_container(config)


def write_run(
    runs,
    experiment="skyocc",
    seed=0,
    *,
    labels=0,
    of=None,
    code="c0de",
    facts=None,
    recipe="strong",
    **changes,
):
    """``<runs>/<experiment>/seed<k>`` of a finished run."""
    folder = runs / experiment / f"seed{seed}"
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config_of(experiment, seed, **changes)))
    if code:
        (folder / ".code").write_text(f"{code}\n")
    facts = {
        **{"scale": "tiny", "seed": seed, "seconds": 1.0, "parameters": 10},
        **{"precision": "32-true", "code_version": "v", "git_commit": "abc"},
        **{"dataset": "tiny-0123", **(facts or {})},
    }
    rows = []
    for name in (experiment, *ANCHORS):
        counted = _counted(name, seed, labels, (of or protocol()).to_json())
        counted = replace(counted, recipe=recipe if name == experiment else NO_RECIPE)
        counted.write(folder / "tallies" / f"{name}.npz")
        rows += result_rows(counted, parts_of(UNSEEN), facts)
    write_results(folder / "results.csv", rows)
    return folder


@cache
def _counted(name, seed, labels, described):
    """Counts do not change, so tests share them."""
    right = RIGHT.get(name, 0.5)
    predict = {
        "all_free": lambda target, n: torch.full_like(target, 8),
        "voxel_prior": partial(_guess, right=0.2, first=0),
        "height_prior": partial(_guess, right=0.3, first=0),
    }.get(name, partial(_guess, right=right, first=1000 * seed))
    return counts(name, predict, labels, Protocol.from_json(described))


def write_ladder(runs, seeds=(0, 1, 2), experiments=tuple(FACTORS)):
    for experiment in experiments:
        for seed in seeds:
            write_run(runs, experiment, seed)
    return runs


def ladder_of(runs):
    """The runs below a folder, read."""
    return [read_run(path) for path in sorted(runs.glob("*/seed*"))]
