"""task=calibrate: fits a checkpoint's probabilities to the frequencies on validation."""

from collections.abc import Mapping
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
from ..data.datamodule import SkyShieldData
from ..data.truth import truth_of
from ..errors import UserError
from ..limits import require_choice, require_count
from ..metrics.suite import ScoreSuite
from ..models.calibrator import Calibrator, Kind, fitted
from ..models.checkpoint import read_content
from ..models.weights import ORIGIN
from ..ontology import FREE
from ..results.files import write_table
from ..terminal import say, tracked
from .scoring import clips_of, score_settings
from .session import Session
from .trainer import Predictor, predictor

SCORES = ("occupied_ece", "tube_ece", "occupied_brier", "tube_brier", "ece", "nll")
METRICS = ("calibration", "occupied")
BEFORE, AFTER = "as trained", "calibrated"


def calibrate(cfg: DictConfig, kind: str, voxels: int) -> Path:
    """Writes ``<checkpoint>-calibrated.ckpt``, a table and reliability diagrams to
    ``<run>/calibration``, and says where.

    ``kind`` is that of `Calibrator`. Of each validation frame so many ``voxels`` are drawn, from
    those that are known. The table has validation, which was fitted, and test. Raises `UserError`
    as `Session.checkpoint` and `fitted` do.
    """
    require_choice("task.kind", kind, get_args(Kind))
    if lacking := [name for name in METRICS if name not in cfg.suite.metrics]:
        raise UserError(f"suite.metrics: lacks {lacking[0]}, which a calibration is judged by")
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
    suites = {part: _scored(cfg, data, part, logits_of, calibrator) for part in ("val", "test")}
    _tell(suites, folder / "calibration.csv")
    # Fitting needs no drawing code; it is loaded for the picture alone.
    from ..report.reliability import draw_reliability

    counts = {name: suite.counts()["occupied"] for name, suite in suites["test"].items()}
    draw_reliability(suites["test"][BEFORE].metric("occupied"), counts, folder / "reliability.png")
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


def _scored(
    cfg: DictConfig, data: SkyShieldData, part: str, logits_of: Predictor, calibrator: Calibrator
) -> dict[str, ScoreSuite]:
    """Returns the metrics of a part of the split, before and after."""
    settings, clips = score_settings(cfg)[1], clips_of(data.split[part])
    settings["metrics"] = {name: settings["metrics"][name] for name in METRICS}
    suites = {name: ScoreSuite(data.grid, clips, settings) for name in (BEFORE, AFTER)}
    for batch in tracked(data.in_order(part), f"scoring {part}"):
        logits = logits_of(batch)
        suites[BEFORE].update(logits.cpu(), truth_of(batch))
        suites[AFTER].update(calibrator(logits).cpu(), truth_of(batch))
    return suites


def _tell(suites: Mapping[str, Mapping[str, ScoreSuite]], path: Path) -> None:
    """Writes and prints the scores of both parts, before and after."""
    rows = []
    for part, of_part in suites.items():
        for name, suite in of_part.items():
            scores = suite.scores()
            rows.append({"part": part, "weights": name, **{key: scores[key] for key in SCORES}})
    write_table(pd.DataFrame(rows), path)

    table = Table(title="Calibration (lower is better); val was fitted")
    for column in ("part", "weights", *SCORES):
        table.add_column(column, justify="left" if column in ("part", "weights") else "right")
    for row in rows:
        table.add_row(row["part"], row["weights"], *(f"{row[key]:.4f}" for key in SCORES))
    Console(width=120).print(table)
