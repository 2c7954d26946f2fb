"""task=calibrate: fits a checkpoint's probabilities to the frequencies on validation."""

from pathlib import Path
from typing import get_args

import pandas as pd
import torch
from jaxtyping import Float, Int64
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table
from torch import Tensor

from ..atomic import replacing
from ..data.batch import Batch
from ..data.datamodule import SkyShieldData
from ..data.truth import truth_of
from ..limits import require_choice, require_count
from ..metrics.count_metric import CountMetric
from ..models.calibrator import Calibrator, Kind, fitted
from ..models.checkpoint import read_content
from ..models.weights import ORIGIN
from ..ontology import FREE
from ..results.files import write_table
from ..terminal import say, tracked
from .scoring import suite_of
from .session import Session
from .trainer import Predictor, predictor

SCORES = ("occupied_ece", "tube_ece", "occupied_brier", "tube_brier", "ece", "nll")
METRICS = ("calibration", "occupied")


def calibrate(cfg: DictConfig, kind: str, voxels: int) -> Path:
    """Writes ``<checkpoint>-calibrated.ckpt``, a table and reliability diagrams to
    ``<run>/calibration``, and says where.

    ``kind`` is that of `Calibrator`. Of each validation frame so many ``voxels`` are drawn, from
    those that are known. The table has validation, which was fitted, and test. Raises `UserError`
    as `Session.checkpoint` and `fitted` do.
    """
    require_choice("task.kind", kind, get_args(Kind))
    require_count("task.voxels", voxels)
    session = Session(cfg)
    trainer, checkpoint, data = session.trainer, session.checkpoint("calibrate"), session.data
    network = checkpoint.network()
    logits_of = predictor(network, trainer)
    facts = fitted(kind, *_drawn(data, logits_of, voxels, cfg.seed))

    folder = session.folder.path / "calibration"
    path = folder / f"{checkpoint.path.stem}-calibrated.ckpt"
    content = read_content(checkpoint.path)
    content[ORIGIN]["calibration"] = facts
    with replacing(path) as temporary:
        torch.save(content, temporary)

    calibrator = Calibrator.of(data.grid, facts).to(network.device)
    metrics = {}
    for part in ("val", "test"):
        metrics |= _counted(cfg, data, part, logits_of, calibrator)
    _tell(metrics, folder / "calibration.csv")
    # Fitting needs no drawing code; it is loaded for the picture alone.
    from ..report.reliability import draw_reliability

    of_test = {name: metrics["test", name]["occupied"] for name in ("as trained", "calibrated")}
    draw_reliability(of_test, folder / "reliability.png")
    for written in (path, folder / "calibration.csv", folder / "reliability.png"):
        say(written)
    return path


def _drawn(
    data: SkyShieldData, logits_of: Predictor, voxels: int, seed: int
) -> tuple[Float[Tensor, "n 9"], Int64[Tensor, "n"], Float[Tensor, "n"]]:
    """Returns logits, labels and distances from the UAV of voxels of all validation frames."""
    generator = torch.Generator().manual_seed(seed)
    distance_m = data.grid.centers().norm(dim=-1).flatten()
    drawn = []
    for batch in tracked(data.in_order("val"), "calibrating"):
        for logits, semantics in zip(logits_of(batch).cpu(), batch["semantics"]):
            known = torch.nonzero(semantics.flatten() <= FREE)[:, 0]
            some = known[torch.randperm(len(known), generator=generator)[:voxels]]
            target = semantics.flatten()[some].long()
            drawn.append((logits.flatten(1)[:, some].T, target, distance_m[some]))
    return tuple(map(torch.cat, zip(*drawn)))


def _counted(
    cfg: DictConfig, data: SkyShieldData, part: str, logits_of: Predictor, calibrator: Calibrator
) -> dict[tuple[str, str], dict[str, CountMetric]]:
    """Returns the metrics of a part of the split, before and after."""
    suite = suite_of(cfg, data)
    scored = {
        (part, name): {each: suite.metric(each).clone() for each in METRICS}
        for name in ("as trained", "calibrated")
    }

    def count(metrics: dict[str, CountMetric], logits: Tensor, batch: Batch) -> None:
        truth = truth_of(batch)
        target, velocity_mps = truth["semantics"], truth["velocity_mps"]
        metrics["calibration"].update(logits, target, velocity_mps)
        occupied = 1 - logits.softmax(dim=1)[:, FREE]
        metrics["occupied"].update(occupied, target, velocity_mps)

    for batch in tracked(data.in_order(part), f"scoring {part}"):
        logits = logits_of(batch)
        count(scored[part, "as trained"], logits.cpu(), batch)
        count(scored[part, "calibrated"], calibrator(logits).cpu(), batch)
    return scored


def _tell(metrics: dict[tuple[str, str], dict[str, CountMetric]], path: Path) -> None:
    """Writes and prints the scores of both parts, before and after."""
    rows = []
    for (part, name), each in metrics.items():
        scores = {key: value for metric in each.values() for key, value in metric.compute().items()}
        rows.append({"part": part, "weights": name, **{key: float(scores[key]) for key in SCORES}})
    write_table(pd.DataFrame(rows), path)

    table = Table(title="Calibration (lower is better); val was fitted")
    for column in ("part", "weights", *SCORES):
        table.add_column(column, justify="left" if column in ("part", "weights") else "right")
    for row in rows:
        table.add_row(row["part"], row["weights"], *(f"{row[key]:.4f}" for key in SCORES))
    Console(width=120).print(table)
