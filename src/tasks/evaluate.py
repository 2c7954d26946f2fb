"""Scores a trained model and the anchors on the test split, and draws what it sees."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from jaxtyping import UInt8
from omegaconf import DictConfig
from torch import Tensor

from ..data.batches import frames_in_order
from ..data.datamodule import SkyShieldData
from ..data.truth import truth_at
from ..models.checkpoint import Origin
from ..models.module import OccupancyModule
from ..models.prior import seen_from
from ..ontology import FREE
from ..results import files
from ..results.counts import Counts, parts_of
from ..results.summary import print_summary
from ..run_folder import ANCHORS, NO_RECIPE, UNKNOWN_RECIPE, RunFolder
from ..terminal import metered, say, tracked
from .scoring import protocol_of, suite_of
from .session import Session
from .trainer import is_first_process

# Frames on the sheet of a run.
SHOWN_FRAMES = 5
# From the UAV's height in voxels to a prediction.
Anchor = Callable[[int], UInt8[Tensor, "X Y Z"]]


def evaluate(session: Session, module: OccupancyModule, folder: RunFolder) -> None:
    """Writes ``results.csv``, ``scores.csv``, the counts and the figures, and prints the table.

    The results come last: a folder with ``results.csv`` is complete.
    """
    cfg, data, trainer = session.cfg, session.data, session.trainer
    start_s = time.perf_counter()
    trainer.test(module, datamodule=data, verbose=False)
    seconds = time.perf_counter() - start_s
    samples = _scored(session)
    protocol = protocol_of(cfg, data, len(samples))
    # Adds up the counts of all processes.
    scored = [Counts.of(cfg.name, protocol, module.test_suite, samples, cfg.recipe_name)]
    _part_company()
    if not is_first_process():
        return

    parts = parts_of(cfg.data.test_clips)
    facts = session.facts(module.network) | {"seconds": round(seconds, 1)}
    rows = files.result_rows(scored[0], parts, facts)
    for name, labels in anchors_of(module.origin).items():
        start_s, suite = time.perf_counter(), suite_of(cfg, data)
        for clip, frame in tracked(samples, f"scoring {name}"):
            suite.update(labels(data.layer(clip, frame))[None], truth_at(data.clips[clip], frame))
        scored.append(Counts.of(name, protocol, suite, samples, NO_RECIPE))
        seconds = round(time.perf_counter() - start_s, 1)
        # An anchor has no network.
        of_anchor = {"seconds": seconds, "parameters": 0, "precision": "none"}
        rows += files.result_rows(scored[-1], parts, facts | of_anchor)

    with metered("resampling clips for the intervals"):
        files.write_scores(folder.path, {cfg.seed: scored}, parts)
    with metered("drawing"):
        _draw(cfg, folder, module, data)
    files.write_results(folder.results, sorted(rows, key=lambda row: row["split"]))
    show(folder, cfg)


def show(folder: RunFolder, cfg: DictConfig) -> None:
    """Prints the main scores of a run, and where everything else is."""
    words = [f"scale={cfg.scale_name}"]
    if cfg.recipe_name not in ("strong", UNKNOWN_RECIPE):
        words.append(f"recipe={cfg.recipe_name}")
    if cfg.paths.runs != "runs":
        words.append(f"paths.runs={cfg.paths.runs}")
    # A report is of trainings.
    is_run = folder.path == Path(cfg.paths.run)
    then = f"python run.py task=report {' '.join(words)}" if is_run else ""
    print_summary(folder.path, cfg.name, then)
    say(f"Predictions beside the ground truth: {folder.figures}")


def anchors_of(origin: Origin) -> dict[str, Anchor]:
    """Returns the predictions that never look at an image, by their names."""
    prior = origin.voxel_prior

    def by_height(layer: int) -> UInt8[Tensor, "X Y Z"]:
        return seen_from(origin.height_prior, layer - origin.lowest_layer, prior.shape[2])

    free = torch.full_like(prior, FREE)
    return dict(zip(ANCHORS, (lambda layer: free, lambda layer: prior, by_height)))


def _scored(session: Session) -> Sequence[tuple[str, int]]:
    """Returns the frames of the test split that the model was scored on: the first ones, where
    ``trainer.limit_test_batches`` leaves some out."""
    data, trainer = session.data, session.trainer
    samples, (batches,) = data.split["test"], trainer.num_test_batches
    return samples[: frames_in_order(batches, len(samples), data.batch_size, trainer.world_size)]


def _part_company() -> None:
    """Ends distributed work; only the first process continues.

    A metric that counts there would otherwise wait for the others.
    """
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


def _draw(cfg: DictConfig, folder: RunFolder, module: OccupancyModule, data: SkyShieldData) -> None:
    """Draws the qualitative sheet, and the learning curves where training has left a log."""
    # Scoring needs no drawing code; it is loaded for the figures alone.
    from ..report.curves import draw_curves
    from .scenes import draw_sheet

    heading = f"{cfg.name}, {cfg.scale_name}"
    draw_sheet(module, data, "test", folder.figures / "qualitative.png", heading, SHOWN_FRAMES)
    if folder.metrics.is_file():
        draw_curves(folder.metrics, folder.figures / "curves.png")
