"""Which learning rate each model prefers: the same small search for all, on validation alone."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from src.dotted import value_at
from src.errors import UserError
from src.results.render import Cell, Row, Table
from src.results.runs import run_folders
from src.run_folder import CONFIG, METRICS, read_config

LR, SCORE = "optimizer.lr", "val/kar_miou"


def search_table(places: Sequence[Path], order: Sequence[str], out: Path) -> Table:
    """Returns the highest KAR-mIoU on validation of every model, in the given order and then by
    name, by its learning rate.

    Raises `UserError` for a run without a log, and for two of one model and learning rate.
    """
    scores: dict[tuple[float, str], float] = {}
    samples = set()
    for folder in run_folders(places, out):
        config = read_config(folder / CONFIG, "so this is no run of a search")
        lr, name = float(value_at(config, LR)), str(config["name"])
        if (lr, name) in scores:
            raise UserError(f"task.search: {folder}: a second run of {name} with {LR}={lr:g}")
        log = pd.read_csv(folder / METRICS) if (folder / METRICS).is_file() else pd.DataFrame()
        if SCORE not in log:
            raise UserError(f"task.search: {folder} has no {METRICS} with {SCORE} yet; let it end")
        scores[lr, name] = 100 * float(log[SCORE].max())
        keys = ("trainer.max_epochs", "trainer.limit_train_batches", "seed")
        samples.add(tuple(value_at(config, key) for key in keys))

    found = {name for _, name in scores}
    names = [name for name in order if name in found] + sorted(found - {*order})
    rates = sorted({lr for lr, _ in scores})
    rows: list[Row] = [
        (f"{lr:g}", [Cell(scores[lr, name]) if (lr, name) in scores else None for name in names])
        for lr in rates
    ]
    effort = "; ".join(
        f"{epochs} epochs of {1 if limit is None else limit} of the frames, seed {seed}"
        for epochs, limit, seed in sorted(samples, key=str)
    )
    text = f"KAR-mIoU on validation, in percent, of the best epoch. Each training: {effort}."
    return Table(
        "lr_search",
        "The learning rate of each model",
        text,
        names,
        rows,
        head="Learning rate",
        best=dict.fromkeys(names, "high"),
    )
