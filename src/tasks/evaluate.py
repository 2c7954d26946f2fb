"""Scores a trained model and the two anchors on the test split, and draws what it sees."""

import time
from collections.abc import Sequence
from pathlib import Path

import lightning
import numpy as np
import torch
from jaxtyping import UInt8
from omegaconf import DictConfig
from torch import Tensor

from ..data.batches import frames_in_order
from ..data.datamodule import SkyShieldData
from ..data.truth import truth_at
from ..metrics.suite import ScoreSuite
from ..models.module import OccupancyModule
from ..ontology import FREE
from ..provenance import git_commit
from ..report.curves import draw_curves
from ..report.qualitative import pick_frames, qualitative_sheet
from ..report.results import print_results, read_results, write_results
from ..report.scores import result_rows, write_scores
from ..run_folder import ANCHORS, RunFolder
from ..terminal import say, tracked
from .processes import is_first_process, part_company
from .scenes import labels_of, scene_of
from .scoring import parts_of, protocol_of, suite_of, tally_of

SHOWN_FRAMES = 5
COMPUTES_NOTHING = {"parameters": 0, "precision": "none"}
"""What an anchor has for a network."""


def evaluate(
    cfg: DictConfig,
    folder: RunFolder,
    trainer: lightning.Trainer,
    module: OccupancyModule,
    data: SkyShieldData,
) -> None:
    """Writes ``results.csv``, ``scores.csv``, the tallies and the figures, and prints the table.

    The results come last: a folder with ``results.csv`` is complete.
    """
    start_s = time.perf_counter()
    trainer.test(module, datamodule=data, verbose=False)
    seconds = time.perf_counter() - start_s
    samples = _scored(trainer, data)
    protocol = protocol_of(cfg, data, len(samples))
    # Adds up what all processes have counted.
    tally = tally_of(cfg.name, protocol, module.test_suite, samples)
    part_company()
    if not is_first_process():
        return
    parts, shared = parts_of(cfg.data.test_clips), _facts(cfg, folder, data)
    parameters = sum(p.numel() for p in module.network.parameters())
    facts = {**shared, "parameters": parameters, "precision": trainer.precision}
    facts["seconds"] = round(seconds, 1)
    tallies, rows = [tally], result_rows(tally, parts, facts)
    for name, prediction in _anchors(module).items():
        start_s = time.perf_counter()
        suite = anchor_scores(name, prediction, data, samples, suite_of(cfg, data))
        tallies.append(tally_of(name, protocol, suite, samples))
        facts = {**shared, **COMPUTES_NOTHING, "seconds": round(time.perf_counter() - start_s, 1)}
        rows += result_rows(tallies[-1], parts, facts)
    write_scores(folder.path, tallies, parts)
    _draw(cfg, folder, module, data)
    write_results(folder.results, sorted(rows, key=lambda row: row["split"]))
    print_results(read_results(folder.results))
    say(f"{folder.results} and {folder.figures}")


def _facts(cfg: DictConfig, folder: RunFolder, data: SkyShieldData) -> dict:
    """What the rows of the model and of the anchors have in common."""
    return {
        "scale": cfg.scale_name,
        "seed": cfg.seed,
        "code_version": folder.version,
        "git_commit": git_commit(),
        "dataset": data.root.name,
    }


def _anchors(module: OccupancyModule) -> dict[str, UInt8[Tensor, "X Y Z"]]:
    """What is predicted for every frame by those that never look at one."""
    labels = module.origin.voxel_prior
    return dict(zip(ANCHORS, (torch.full_like(labels, FREE), labels)))


def _draw(cfg: DictConfig, folder: RunFolder, module: OccupancyModule, data: SkyShieldData) -> None:
    draw_sheet(module, data, folder.figures / "qualitative.png", f"{cfg.name}, {cfg.scale_name}")
    if folder.metrics.is_file():
        draw_curves(folder.metrics, folder.figures / "curves.png")


def _scored(trainer: lightning.Trainer, data: SkyShieldData) -> Sequence[tuple[str, int]]:
    """The frames of the test split that the model was scored on: the first ones, where
    ``trainer.limit_test_batches`` leaves some out."""
    samples, (batches,) = data.split["test"], trainer.num_test_batches
    count = frames_in_order(batches, len(samples), data.batch_size, trainer.world_size)
    return samples[:count]


def anchor_scores(
    name: str,
    prediction: UInt8[Tensor, "X Y Z"],
    data: SkyShieldData,
    samples: Sequence[tuple[str, int]],
    suite: ScoreSuite,
) -> ScoreSuite:
    """Counts one fixed prediction on the frames named."""
    for clip, frame in tracked(samples, f"scoring {name}"):
        suite.update(prediction[None], truth_at(data.clips[clip], frame))
    return suite


def draw_sheet(module: OccupancyModule, data: SkyShieldData, path: Path, heading: str) -> None:
    """The qualitative sheet of a few test frames, chosen by `pick_frames`."""
    dataset = data.dataset("test")
    tilt_rad = np.array([_tilt_rad(data, *sample) for sample in dataset.samples])
    module.eval()
    samples = [dataset[index] for index in pick_frames(tilt_rad, SHOWN_FRAMES)]
    scenes = [
        scene_of(sample, data.grid, {"Prediction": labels_of(module, sample)}) for sample in samples
    ]
    qualitative_sheet(scenes, path, heading)


def _tilt_rad(data: SkyShieldData, clip: str, frame: int) -> float:
    row = data.clips[clip].frames.loc[frame]
    return abs(row["roll_rad"]) + abs(row["pitch_rad"])
