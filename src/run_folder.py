"""The folder of one run: what is in it, and whether a new run may go on there."""

import json
import os
from pathlib import Path

import pandas as pd
import yaml

from .errors import UserError
from .provenance import code_version

CONFIG = "config.yaml"
METRICS = "metrics.csv"
RESULTS = "results.csv"
CHECKPOINTS = "checkpoints"
SESSIONS = "sessions"
PLACE_KEYS = ("paths", "ckpt_path", "task", "overwrite", "name", "hydra")
"""Configuration that says where and what to do, not how the model is trained."""


class RunFolder:
    """``runs/<scale>/<experiment>/seed<k>/``: config, metrics, results, checkpoints and figures."""

    def __init__(self, path: Path, config: dict) -> None:
        self.path = Path(path)
        self.config = config
        self.version = code_version(trained_by(config))

    @property
    def results(self) -> Path:
        return self.path / RESULTS

    @property
    def checkpoints(self) -> Path:
        return self.path / CHECKPOINTS

    @property
    def figures(self) -> Path:
        return self.path / "figures"

    @property
    def best_checkpoint(self) -> Path:
        return self.checkpoints / "best.ckpt"

    @property
    def last_checkpoint(self) -> Path:
        return self.checkpoints / "last.ckpt"

    def is_finished(self) -> bool:
        """Whether the results of this very configuration and code are there."""
        return self.results.is_file() and self._recorded() == self.version

    def open(self, afresh: bool) -> Path | None:
        """Makes the folder ready and returns the checkpoint to go on from, if there is one.

        What another configuration or other code left here is moved aside, never overwritten; so is
        everything when the run shall start afresh.
        """
        same = not afresh and self._recorded() == self.version
        resumable = same and self.last_checkpoint.is_file()
        if not resumable and self.path.exists():
            os.rename(self.path, self._free_name())
        self.path.mkdir(parents=True, exist_ok=True)
        text = yaml.safe_dump(self.config, sort_keys=False)
        _write(self.path / CONFIG, text)
        _write(self.path / ".version", self.version + "\n")
        return self.last_checkpoint if resumable else None

    def write_json(self, name: str, data: dict) -> None:
        """Writes a small file of facts about the run."""
        _write(self.path / name, json.dumps(data, indent=1) + "\n")

    def require_same_config(self) -> None:
        """Refuses to resume a run that was started under another configuration."""
        path = self.path / CONFIG
        try:
            before = yaml.safe_load(path.read_text())
        except (OSError, yaml.YAMLError) as error:
            raise UserError(f"{path}: cannot be read ({error}); there is no run to resume") from None
        for key, old, new in differences(trained_by(before), trained_by(self.config)):
            raise UserError(
                f"{path}: the run was started with {key}={json.dumps(old)}, and now it is "
                f"{json.dumps(new)}; resume with the old value, or start anew without ckpt_path"
            )

    def merge_metrics(self) -> None:
        """Joins the CSV logs of all sessions of this run into ``metrics.csv``.

        A session begins at the step of the checkpoint that it was resumed from; what an earlier
        one logged beyond that was lost with its weights, so it is left out.
        """
        tables: list[pd.DataFrame] = []
        for log in sorted(self.path.glob(f"{SESSIONS}/*/{METRICS}")):
            if log.stat().st_size:
                table = pd.read_csv(log)
                tables = [earlier[earlier["step"] < table["step"].min()] for earlier in tables]
                tables.append(table)
        if tables:
            joined = pd.concat(tables).groupby("step", as_index=False).last()
            _write(self.path / METRICS, joined.to_csv(index=False))

    def _recorded(self) -> str:
        path = self.path / ".version"
        return path.read_text().strip() if path.is_file() else ""

    def _free_name(self) -> Path:
        number = 1
        while (aside := self.path.with_name(f"{self.path.name}.before{number}")).exists():
            number += 1
        return aside


def trained_by(config: dict) -> dict:
    """The part of a configuration that shapes the trained model and its scores."""
    return {key: value for key, value in config.items() if key not in PLACE_KEYS}


def differences(before: dict, after: dict, prefix: str = "") -> list[tuple[str, object, object]]:
    """Dotted keys whose values differ, with both values."""
    found = []
    for key in sorted(before.keys() | after.keys()):
        old, new = before.get(key), after.get(key)
        if isinstance(old, dict) and isinstance(new, dict):
            found += differences(old, new, f"{prefix}{key}.")
        elif old != new:
            found.append((prefix + key, old, new))
    return found


def _write(path: Path, text: str) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_text(text)
    os.replace(part, path)
