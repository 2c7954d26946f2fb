"""Scores a trained model and the two anchors on the test split, and draws what it sees."""

import time
from collections.abc import Sequence

import lightning
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
from ..results import files
from ..run_folder import ANCHORS, RunFolder
from ..terminal import say, tracked
from .processes import is_first_process, part_company
from .scoring import counts_of, parts_of, protocol_of, suite_of

# Frames on the sheet of a run.
SHOWN_FRAMES = 5


def evaluate(
    cfg: DictConfig,
    folder: RunFolder,
    trainer: lightning.Trainer,
    module: OccupancyModule,
    data: SkyShieldData,
) -> None:
    """Writes ``results.csv``, ``scores.csv``, the counts and the figures, and prints the table.

    The results come last: a folder with ``results.csv`` is complete.
    """
    start_s = time.perf_counter()
    trainer.test(module, datamodule=data, verbose=False)
    seconds = time.perf_counter() - start_s
    samples = _scored(trainer, data)
    protocol = protocol_of(cfg, data, len(samples))
    # Adds up the counts of all processes.
    counts = counts_of(cfg.name, protocol, module.test_suite, samples)
    part_company()
    if not is_first_process():
        return

    parts, shared = parts_of(cfg.data.test_clips), _facts(cfg, folder, data)
    parameters = sum(p.numel() for p in module.network.parameters())
    facts = {"parameters": parameters, "precision": trainer.precision}
    facts["seconds"] = round(seconds, 1)
    scored, rows = [counts], files.result_rows(counts, parts, shared | facts)
    for name, prediction in _anchors(module).items():
        start_s = time.perf_counter()
        suite = anchor_scores(name, prediction, data, samples, suite_of(cfg, data))
        scored.append(counts_of(name, protocol, suite, samples))
        # An anchor has no network.
        facts = {"parameters": 0, "precision": "none"}
        facts["seconds"] = round(time.perf_counter() - start_s, 1)
        rows += files.result_rows(scored[-1], parts, shared | facts)

    files.write_scores(folder.path, {cfg.seed: scored}, parts)
    _draw(cfg, folder, module, data)
    files.write_results(folder.results, sorted(rows, key=lambda row: row["split"]))
    files.print_results(files.read_results(folder.results))
    say(f"{folder.results} and {folder.figures}")


def _facts(cfg: DictConfig, folder: RunFolder, data: SkyShieldData) -> dict:
    """Returns what the rows of the model and of the anchors have in common."""
    return {
        "scale": cfg.scale_name,
        "seed": cfg.seed,
        "code_version": folder.version,
        "git_commit": git_commit(),
        "dataset": data.root.name,
    }


def _anchors(module: OccupancyModule) -> dict[str, UInt8[Tensor, "X Y Z"]]:
    """Returns the predictions that never look at a frame, and so are the same for each."""
    labels = module.origin.voxel_prior
    return dict(zip(ANCHORS, (torch.full_like(labels, FREE), labels)))


def _draw(cfg: DictConfig, folder: RunFolder, module: OccupancyModule, data: SkyShieldData) -> None:
    # Scoring needs no drawing code; it is loaded for the figures alone.
    from ..report.curves import draw_curves
    from .scenes import draw_sheet

    heading = f"{cfg.name}, {cfg.scale_name}"
    draw_sheet(module, data, folder.figures / "qualitative.png", heading, SHOWN_FRAMES)
    if folder.metrics.is_file():
        draw_curves(folder.metrics, folder.figures / "curves.png")


def _scored(trainer: lightning.Trainer, data: SkyShieldData) -> Sequence[tuple[str, int]]:
    """Returns the frames of the test split that the model was scored on: the first ones, where
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
    """Counts one fixed prediction on some frames; returns the suite."""
    for clip, frame in tracked(samples, f"scoring {name}"):
        suite.update(prediction[None], truth_at(data.clips[clip], frame))
    return suite
