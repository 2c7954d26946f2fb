"""Predicted labels on disk: ``<clip>/occupancy.npz`` with a ``semantics_<frame>`` for each frame.

The layout is that of a dataset's own labels. Class scores may lie beside them, in ``logits.npz``
as ``logits_<frame>``, floats [C, X, Y, Z], and in ``knowledge.npz``, as ``knowledge_<frame>``, what
the camera sees of each voxel (`src.knowledge`). ``predictions.json`` says whose they are.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ..atomic import replacing_folder
from ..errors import UserError, is_of_the_system, reason_of, way_out_of
from ..geometry import tensor_of
from ..ontology import NUM_CLASSES
from .files import BROKEN, array_of, fault_of, files_below, open_npz

FACTS = "predictions.json"
LABELS, LOGITS, KNOWLEDGE = "occupancy.npz", "logits.npz", "knowledge.npz"
MOST_NAMED = 3
Sample = tuple[str, int]


class PredictedFrame(NamedTuple):
    """A clip, the number of a frame, its labels, and class scores and knowledge if any."""

    clip: str
    frame: int
    labels: UInt8[Tensor, "X Y Z"]
    logits: Float[Tensor, "C X Y Z"] | None = None
    knowledge: UInt8[np.ndarray, "X Y Z"] | None = None


def save_predictions(folder: Path, facts: dict, frames: Iterable[PredictedFrame]) -> None:
    """Writes predictions, clip by clip; the folder is there when all of them are.

    After a failure nothing is left of them. Raises `UserError`, before the first frame is asked
    for, where the folder exists already.
    """
    if folder.exists():
        raise UserError(f"{folder}: exists already; move it away, or choose another folder")

    with replacing_folder(folder) as new:
        for clip, of_clip in groupby(frames, key=attrgetter("clip")):
            (new / clip).mkdir(parents=True, exist_ok=True)
            _save_clip(new / clip, of_clip)
        (new / FACTS).write_text(json.dumps(facts, indent=1) + "\n")


def _save_clip(folder: Path, frames: Iterable[PredictedFrame]) -> None:
    """Writes a clip's archives, each of them at once; logits with half precision."""
    archives: dict[str, dict[str, np.ndarray]] = {LABELS: {}, LOGITS: {}, KNOWLEDGE: {}}
    for each in frames:
        number, labels = f"{each.frame:06d}", each.labels.cpu().numpy().astype(np.uint8)
        archives[LABELS][f"semantics_{number}"] = labels
        if each.logits is not None:
            archives[LOGITS][f"logits_{number}"] = each.logits.cpu().numpy().astype(np.float16)
        if each.knowledge is not None:
            archives[KNOWLEDGE][f"knowledge_{number}"] = each.knowledge

    for name, arrays in archives.items():
        if arrays or name == LABELS:
            np.savez_compressed(folder / name, **arrays)


@dataclass
class Inventory:
    """The frames that are missing, extra or corrupt in a folder of predictions."""

    missing: list[str] = field(default_factory=list)
    extra: list[str] = field(default_factory=list)
    corrupt: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        parts = []
        for kind, frames in vars(self).items():
            named = [*frames[:MOST_NAMED], "..."] if len(frames) > MOST_NAMED else frames
            if frames:
                parts.append(f"{len(frames)} {kind}: {', '.join(named)}")
        return "; ".join(parts)

    @property
    def sound(self) -> bool:
        return not any(vars(self).values())


class Predictions:
    """Reads a folder of predictions. Raises `UserError` where it is none."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise UserError(f"predictions: {self.folder} is no folder; task=predict writes one")
        self._open: tuple[Path, np.lib.npyio.NpzFile] | None = None

    @property
    def facts(self) -> dict:
        """The content of ``predictions.json``; nothing where there is no such file, or another.

        Raises `UserError` where the system does not let it be read.
        """
        path = self.folder / FACTS
        try:
            facts = json.loads(path.read_text())
        except (OSError, ValueError) as error:
            if is_of_the_system(error):
                way_out = way_out_of(error, "")
                raise UserError(
                    f"{path}: cannot be read ({reason_of(error)}); {way_out}"
                ) from error
            return {}
        return facts if isinstance(facts, dict) else {}

    def labels(self, clip: str, frame: int) -> UInt8[Tensor, "X Y Z"]:
        return tensor_of(self._read(clip, LABELS, f"semantics_{frame:06d}")).to(torch.uint8)

    def logits(self, clip: str, frame: int) -> Float[Tensor, "c X Y Z"] | None:
        """Returns the class scores of a frame as float32, where they were written."""
        if not (self.folder / clip / LOGITS).is_file():
            return None
        return tensor_of(self._read(clip, LOGITS, f"logits_{frame:06d}")).float()

    def inventory(self, samples: Sequence[Sample], shape: tuple[int, int, int]) -> Inventory:
        """Compares what is there with the frames that are asked for, and opens every array."""
        wanted = {(clip, f"semantics_{frame:06d}"): frame for clip, frame in samples}
        present, unreadable = set(), {}
        for path in files_below(self.folder, LABELS):
            clip = path.parent.relative_to(self.folder).as_posix()
            try:
                with open_npz(path) as archive:
                    present |= {(clip, array) for array in archive.files}
            except BROKEN as error:
                unreadable[clip] = f"{path}: cannot be read ({error})"

        # Of a file that cannot be opened nobody knows which frames it holds.
        missing = [each for each in sorted(wanted.keys() - present) if each[0] not in unreadable]
        there = [(each[0], frame) for each, frame in wanted.items() if each in present]
        problems = [self.problem_of(*each, shape) for each in there]
        return Inventory(
            missing=[" ".join(each) for each in missing],
            extra=[" ".join(each) for each in sorted(present - wanted.keys())],
            corrupt=[*unreadable.values(), *filter(None, problems)],
        )

    def problem_of(self, clip: str, frame: int, shape: tuple[int, int, int]) -> str:
        """Says with the file's name why a frame cannot be scored; empty where it can."""
        name, problem = f"semantics_{frame:06d}", ""
        try:
            labels = self._read(clip, LABELS, name)
        except UserError as error:
            return str(error)

        if not_whole := fault_of(labels):
            problem = not_whole
        elif labels.shape != shape:
            problem = f"is {list(labels.shape)}, and the grid is {list(shape)}"
        # A prediction says something of every voxel: unknown is no class of it.
        elif labels.min() < 0 or labels.max() >= NUM_CLASSES:
            problem = f"has classes {labels.min():g} to {labels.max():g}, and there are 0 to 8"
        return f"{self.folder / clip / LABELS}: {name} {problem}" if problem else ""

    def _read(self, clip: str, name: str, array: str) -> np.ndarray:
        path = self.folder / clip / name
        try:
            # Frames come clip by clip, so one open archive is enough.
            if self._open is None or self._open[0] != path:
                self._open = (path, open_npz(path))
            return array_of(self._open[1], array)
        except BROKEN as error:
            self._open = None
            way_out = way_out_of(error, "predict it again", path)
            raise UserError(f"{path}: {array} cannot be read ({error}); {way_out}") from error
