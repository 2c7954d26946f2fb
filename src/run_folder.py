"""The folder of one run: what is in it, and whether a new run may go on there."""

import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path

import pandas as pd
import yaml

from .atomic import replacing
from .data.manifest import NOT_SHAPING, OFF
from .dotted import differences, value_at
from .errors import UserError, is_of_the_system, way_out_of
from .locks import locked, telling
from .provenance import digest_of
from .used_code import code_of, different_file, targets_of

CONFIG = "config.yaml"
METRICS = "metrics.csv"
RESULTS = "results.csv"
SCORES = "scores.csv"
TALLIES = "tallies"
SESSIONS = "sessions"
VERSION = ".version"
CODE = ".code"
BEST, LAST = "checkpoints/best.ckpt", "checkpoints/last.ckpt"
# Predictions that never look at an image, scored beside every run.
ANCHORS = ("all_free", "voxel_prior", "height_prior")
# What lies beside runs and is none: a group's report, and what was moved aside.
REPORT, ASIDE = "report", re.compile(r"\.before\d+$")
# The recipe of what no network predicts, and of what was made before recipes had names.
NO_RECIPE, UNKNOWN_RECIPE = "none", "unknown"
# Beside the classes that its configuration names, this module shapes a trained model.
TRAINING = "src.tasks.model"
# How a run is called, which its checkpoints say as well.
LABEL = ("name", "recipe_name", "group")
# What the keys of a configuration, and the keys below them, say of a run. Every key that is not
# listed shapes its weights or its scores.
KEYS = {
    # Where, how fast and what to do: no part of what shapes a run.
    "place": (
        *("paths", "ckpt_path", "task", "overwrite", "calibrated", *LABEL, "threads"),
        *("predictions", "dataset", "layout", "logger"),
        *("callbacks.progress", "callbacks.preview"),
        *("data.workers", *(f"sim.{key}" for key in NOT_SHAPING)),
        *("trainer.default_root_dir", "trainer.log_every_n_steps"),
        *("trainer.enable_model_summary", "trainer.enable_progress_bar"),
    ),
    # The machine that trains, which another machine need not be like.
    "machine": ("callbacks", "trainer"),
    # How a trained model is scored.
    "scoring": ("data.batch_size", "metric", "suite"),
    # Which flights there are; a trained model may look at others than its own.
    "flights": (
        *("sim.seed", "sim.towns", "sim.town_seeds", "sim.clips_per_town"),
        *("sim.weathers", "sim.weather"),
        *("data.val_clips", "data.test_clips"),
    ),
    # Whose weights a checkpoint holds.
    "identity": ("name", "seed", "model", "loss"),
    # What a training begins with; its checkpoints hold what became of that.
    "start": ("model.backbone.weights", "model.backbone.weights_sha256"),
}


class RunFolder:
    """``runs/<scale>/<experiment>/seed<k>/``: config, metrics, results, checkpoints and figures.

    Another recipe than the default has ``runs/<scale>-<recipe>/`` instead.

    ``version`` is the identity of the run: a digest of the ``code`` that its configuration uses, of
    the name of its ``dataset``, which is a digest of all that shapes the data, and of the
    configuration, without the `KEYS` that only say where and how fast. It is the same wherever the
    folder lies.
    """

    def __init__(self, path: Path, config: dict, dataset: str) -> None:
        self.path, self.config = Path(path), config
        self.results, self.metrics = self.path / RESULTS, self.path / METRICS
        self.figures = self.path / "figures"
        self.best_checkpoint, self.last_checkpoint = self.path / BEST, self.path / LAST
        self.code = code_of([TRAINING, *targets_of(shaping(config))])
        self.version = digest_of([self.code, dataset, shaping(config)])

    def checkpoint(self, name: str) -> Path:
        """Returns the file that ``ckpt_path`` means: ``best`` or ``last`` of this run, or any."""
        return {"best": self.best_checkpoint, "last": self.last_checkpoint}.get(name, Path(name))

    def is_finished(self) -> bool:
        """Tells whether all results of this very configuration and code are there."""
        counted = (self.config["name"], *ANCHORS)
        files = (RESULTS, SCORES, *(f"{TALLIES}/{name}.npz" for name in counted))
        return all((self.path / name).is_file() for name in files) and self._is_same()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keeps others out of the folder: a second process of the same run waits for its turn.

        On a file system that has no locks nobody waits.
        """
        on_wait = telling(f"{self.path}: another process is at work on this run")
        # Beside the folder, which may be moved aside.
        lock = self.path.with_name(f".{self.path.name}.lock")
        lock.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            with suppress(UserError):
                held.enter_context(locked(lock, on_wait))
            yield

    def open(self, afresh: bool) -> Path | None:
        """Makes the folder ready and returns the checkpoint to go on from, if there is one.

        What another configuration or other code left here is moved aside, never overwritten; so is
        everything when the run shall start afresh. A run that was killed before its first
        checkpoint has lost nothing: it begins again where it is.
        """
        checkpoint = self.to_resume(afresh)
        goes_on = not afresh and self._is_same()
        if checkpoint or (goes_on and not any(self.last_checkpoint.parent.glob("*.ckpt"))):
            for left_over in self.path.rglob(".*.tmp"):  # of a process that was killed
                left_over.unlink()
        elif self.path.exists():
            self._move_aside()

        if checkpoint is None:
            shutil.rmtree(self.path / SESSIONS, ignore_errors=True)
            self._write(CONFIG, yaml.safe_dump(self.config, sort_keys=False))
            self._write(VERSION, self.version + "\n")
            self._write(CODE, "".join(f"{digest}  {file}\n" for file, digest in self.code.items()))
        return checkpoint

    def to_resume(self, afresh: bool) -> Path | None:
        """Returns the last checkpoint, where it is of this very configuration and code and the run
        shall not start ``afresh``."""
        goes_on = not afresh and self._is_same() and self.last_checkpoint.is_file()
        return self.last_checkpoint if goes_on else None

    def write_json(self, name: str, data: dict) -> None:
        """Writes a small file of facts about the run."""
        self._write(name, json.dumps(data, indent=1) + "\n")

    def merge_metrics(self) -> None:
        """Joins the CSV logs of all sessions of this run into ``metrics.csv``.

        A session begins at the step of the checkpoint that it was resumed from; what an earlier
        one logged beyond that was lost with its weights, so it is left out.
        """
        joined = pd.DataFrame()
        for table in self._session_logs():
            if len(joined):
                joined = joined[joined["step"] < table["step"].min()]
            joined = pd.concat([joined, table])

        if len(joined):
            # Training and validation write a row each at the same step.
            rows = joined.groupby("step", as_index=False).last()
            self._write(METRICS, rows.to_csv(index=False))

    def _session_logs(self) -> Iterator[pd.DataFrame]:
        """Yields the logs that hold a row, in the order of their sessions."""
        folders = self.path.glob(f"{SESSIONS}/version_*")
        for folder in sorted(folders, key=lambda path: int(path.name.removeprefix("version_"))):
            log = folder / METRICS
            if log.is_file() and log.stat().st_size and len(table := pd.read_csv(log)):
                yield table

    def _is_same(self) -> bool:
        return _recorded(self.path / VERSION) == self.version

    def _move_aside(self) -> None:
        names = (self.path.with_name(f"{self.path.name}.before{n}") for n in count(1))
        aside = next(path for path in names if not path.exists())
        os.rename(self.path, aside)

        file = different_file(recorded_code(aside), self.code)
        reason = f": {file} was another one" if file else ""
        print(f"{self.path}: what was there is kept in {aside.name}{reason}", flush=True)

    def _write(self, name: str, text: str) -> None:
        with replacing(self.path / name) as temporary:
            temporary.write_text(text)


def recorded_code(folder: Path) -> dict[str, str]:
    """Returns the digest of every file that shaped a run, as `code_of` gave them when it began;
    nothing for a run that recorded none. Runs from before version 2 have one digest, of all of
    ``src/``."""
    lines = _recorded(Path(folder) / CODE).splitlines()
    return {file: digest for digest, _, file in (line.partition("  ") for line in lines)}


def _recorded(path: Path) -> str:
    return path.read_text().strip() if path.is_file() else ""


def require_same_config(
    checkpoint: Path, before: dict, config: dict, keys: Sequence[str] = ()
) -> None:
    """Refuses a checkpoint of a run that was started under another configuration.

    ``keys`` narrows the comparison to some, such as those of the identity, less what the training
    began with. Raises `UserError` that names the first key that differs.
    """
    way_out = "or another ckpt_path" if keys else "or drop ckpt_path to start anew"
    for key in keys or sorted(before.keys() | config.keys()):
        for dotted, old, new in differences(*({key: value_at(c, key)} for c in (before, config))):
            if not (keys and dotted in KEYS["start"]):
                raise UserError(
                    f"ckpt_path: {checkpoint} was trained with {dotted}={json.dumps(old)}, and now "
                    f"it is {json.dumps(new)}; give the old value, {way_out}"
                )


def read_config(path: Path, consequence: str) -> dict:
    """Returns the configuration that a run was started with.

    Raises `UserError` where it cannot be read or is none; ``consequence`` ends the message.
    """
    try:
        config = yaml.safe_load(path.read_text())
        shaping(config)
        return config
    except (AttributeError, KeyError, TypeError):
        reason = "it does not say where its run lies"
    except (OSError, ValueError, yaml.YAMLError) as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())
        if is_of_the_system(error):
            way_out = way_out_of(error, "")
            raise UserError(f"{path}: cannot be read ({reason}); {way_out}") from error
    raise UserError(f"{path}: cannot be read ({reason}), {consequence}")


def described(config: dict) -> dict:
    """Returns what a checkpoint holds of a configuration: what shapes it, and how it is called."""
    return {**shaping(config), **{key: config[key] for key in LABEL}}


def shaping(config: dict) -> dict:
    """Returns the part of a configuration that shapes the trained model and its scores."""
    run = str(config["paths"]["run"])

    # The values of a weather that no clip has shape nothing.
    sim = {"weather": {}, "weathers": (), **config.get("sim", {})}
    unused = [f"sim.weather.{name}" for name in sim["weather"] if name not in sim["weathers"]]
    unused += [f"sim.{key}" for key, off in OFF.items() if sim.get(key) == off]

    def kept(node: object, prefix: str) -> object:
        if isinstance(node, dict):
            names = [name for name in node if prefix + name not in (*KEYS["place"], *unused)]
            return {name: kept(node[name], f"{prefix}{name}.") for name in names}
        # The run's own folder appears in the settings of callbacks and loggers.
        return node.removeprefix(run) if isinstance(node, str) else node

    return kept(config, "")
