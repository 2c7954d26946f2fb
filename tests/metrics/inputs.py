"""What the tests of several metrics share: marks, logits, rays, a line of voxels, settings."""

import math

import torch
from omegaconf import OmegaConf

from src.geometry import VoxelGrid
from src.ontology import FREE

CLIPS = ["town/clip00", "town/clip01", "town/clip02"]
PAPER_METRIC = OmegaConf.to_container(OmegaConf.load("conf/metric/occupancy.yaml"))
METRIC = {key: value for key, value in PAPER_METRIC.items() if not key.startswith("_")}
FOUR_CLASSES = {"num_classes": 4, "free_index": 0, "ignore_index": -100}
LINE = VoxelGrid(lower_m=(0, -1, -1), upper_m=(20, 1, 1), shape=(10, 1, 1))  # 1, 3, 5 ... m away


def line(**occupied):
    """Free labels of `LINE` with class ids at ``x<index>``."""
    labels = torch.full((1, *LINE.shape), FREE)
    for name, class_id in occupied.items():
        labels[0, int(name[1:])] = class_id
    return labels


def coins(seed, like, chance=0.5):
    """A random mask of this shape."""
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(seed)) < chance


def random_logits(seed, target, num_classes=9):
    rng = torch.Generator().manual_seed(seed)
    return 2.0 * torch.randn(len(target), num_classes, *target.shape[1:], generator=rng)


def random_rays(seed, frames=4, n=12):
    """Origins, half of them in the grid, and directions."""
    rng = torch.Generator().manual_seed(seed)
    origin_m = torch.rand(frames, 3, generator=rng, dtype=torch.float64)
    origin_m = origin_m * torch.tensor([24.0, 20.0, 12.0]) + torch.tensor([0.0, -10.0, -6.0])
    origin_m[::2, 0] -= 27.0
    towards = torch.rand(frames, n, 3, generator=rng, dtype=torch.float64)
    towards = towards * torch.tensor([24.0, 24.0, 16.0]) + torch.tensor([0.0, -12.0, -8.0])
    return origin_m, torch.nn.functional.normalize(towards - origin_m[:, None], dim=-1)


def with_metrics(metric, changes):
    """The suite of `conf/suite/default.yaml` with these changes, and the metrics that it lists."""
    suite = OmegaConf.merge(OmegaConf.load("conf/suite/default.yaml"), changes)
    metric = metric | {"_target_": "src.metrics.OccupancyScores"}
    cfg = OmegaConf.create({"metric": metric, "suite": suite})
    return OmegaConf.to_container(cfg.suite, resolve=True)


SUITE = with_metrics(METRIC, {"tube_radius_m": 3.0, "rays": [6, 4], "resamples": 50})


def truth_of(target, velocity, clips):
    """The ground truth of a batch, which a level camera of 64 by 32 pixels sees."""
    level = torch.tensor([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    lens = torch.tensor([[32.0, 0, 32], [0, 32, 16], [0, 0, 1]])
    return {
        "clip": clips,
        "semantics": target,
        "velocity_mps": velocity,
        "visible": target < 4,
        "camera_from_occ": level.expand(len(target), 4, 4),
        "pix_from_camera": lens.expand(len(target), 3, 3),
        "size_pix": (64, 32),
    }


def one_hot(labels):
    """Logits of these labels."""
    return torch.nn.functional.one_hot(labels.long(), 9).movedim(-1, 1).float()


def mean(values):
    """The mean of the numbers that are not NaN; NaN of none."""
    values = [value for value in values if not math.isnan(value)]
    return sum(values) / len(values) if values else math.nan


def updated(metric, *batches):
    """The metric itself, which has counted the batches."""
    for batch in batches:
        metric.update(*batch)
    return metric


def scores_of(metric, *batches):
    """The scores of a metric that has counted the batches, as plain numbers."""
    scores = updated(metric, *batches).compute()
    return {name: float(score) for name, score in scores.items()}


def assert_same(actual, expected):
    """Of counts or scores: the same to the last bit, NaN included."""
    torch.testing.assert_close(actual, expected, rtol=0, atol=0, equal_nan=True)
