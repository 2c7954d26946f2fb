"""Predictions beside their ground truth, in our layout or in another tool's."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from ..data.predictions import FACTS, Inventory, Predictions
from ..data.truth import SkyShieldTruth
from ..errors import UserError, closest
from ..formats import LABEL_FORMATS
from ..formats.folder import LabelFolder
from ..formats.label_format import LabelFormat
from ..formats.layout import LAYOUT, layout_beside
from ..geometry import VoxelGrid
from ..limits import require_choice
from ..metrics.protocol import SUPERVISED, VISIBLE
from ..provenance import digest_of
from ..recordings.classes import class_map_of
from ..terminal import say
from .dataset import root_of

Sample = tuple[str, int] | tuple[str, str]


class SkyShieldPairing:
    """Predictions and ground truth in the layout of this project."""

    def __init__(self, cfg: DictConfig, folder: Path, part: str) -> None:
        require_choice("layout.mask", cfg.layout.mask, ("supervised", "visible"))
        self._predictions = Predictions(folder)
        self.facts = self._predictions.facts
        self._truth = truth_for(cfg, part, self._predictions)
        self.dataset = self._truth.name
        self._visible = cfg.layout.mask == "visible"
        self.mask = VISIBLE if self._visible else SUPERVISED
        self.grid = self._truth.grid
        self.samples, self.unseen = self._truth.samples, self._truth.unseen

    def inventory(self) -> Inventory:
        return self._predictions.inventory(self.samples, self.grid.shape)

    def has(self, sample: Sample) -> bool:
        return not self._predictions.problem_of(*sample, self.grid.shape)

    def frame(self, sample: Sample) -> tuple[Tensor, dict, Tensor | None]:
        """Returns predicted labels, their target, and logits if there are any: batches of one."""
        truth = self._truth.truth(*sample)
        if self._visible:
            truth["mask"] = truth["visible"]
        logits = self._predictions.logits(*sample)
        labels = self._predictions.labels(*sample)
        return labels[None], truth, None if logits is None else logits[None]


def truth_for(cfg: DictConfig, part: str, predictions: Predictions | None) -> SkyShieldTruth:
    """Returns the labels of ``dataset`` (null: the configured one), as the split of the predictions
    has them.

    Raises `UserError` for predictions of another dataset, and as `SkyShieldTruth` does.
    """
    root = Path(cfg.dataset) if cfg.dataset else root_of(cfg)
    if predictions is None:
        return SkyShieldTruth(root, part)

    facts, folder = predictions.facts, predictions.folder
    if facts.get("dataset", root.name) != root.name:
        raise UserError(
            f"{folder}: these are predictions of {facts['dataset']}, not of {root.name}; name the "
            "dataset that they were made on, as dataset=DIR"
        )
    return SkyShieldTruth(root, part, _held_out(facts, folder))


def _held_out(facts: Mapping[str, object], folder: Path) -> dict[str, list[str]] | None:
    """Returns the clips that the split of the predictions holds out, where they say so."""
    held_out = facts.get("held_out")
    if held_out is None:
        return None
    try:
        return {part: [str(clip) for clip in held_out[part]] for part in ("val", "test")}
    except (KeyError, TypeError) as error:
        raise UserError(
            f"{folder / FACTS}: held_out: {held_out!r} does not list the clips of val and of test; "
            "correct it, or leave it out"
        ) from error


class FormatPairing:
    """Predictions and ground truth in another tool's format; the configuration states the rest.

    Where the labels have a ``layout.json``, as `task=export_labels` writes, that states it.
    """

    def __init__(self, cfg: DictConfig, folder: Path, part: str) -> None:
        of, layout = LABEL_FORMATS[cfg.layout.name], OmegaConf.to_container(cfg.layout)
        if cfg.dataset is None or not Path(cfg.dataset).is_dir():
            raise UserError(
                f"dataset: {cfg.dataset} is no folder; name the one with labels of {of.name}, as "
                "dataset=DIR"
            )

        root = Path(cfg.dataset)
        truth = _stated(of, layout, root)
        require_choice("layout.mask", layout["mask"], (*of.masks, "supervised"))

        self.grid = VoxelGrid(**truth["grid"])
        self._truth = LabelFolder(of, root, truth["class_map"], self.grid)
        # Without a word of their own, predictions have the ids of the labels.
        theirs = truth | layout_beside(folder, of.name)
        if VoxelGrid(**theirs["grid"]) != self.grid:
            raise UserError(
                f"{folder / LAYOUT}: grid: is another than that of {root}; predict on it"
            )
        self._predictions = LabelFolder(of, folder, theirs["class_map"], self.grid, predicted=True)
        self._velocity_mps = self._velocities(truth["velocity_mps"], root)

        self._format, self._mask = of, layout["mask"]
        self._masked = self._mask in of.masks
        # None of this is in the files themselves, so that scores depend on what was stated.
        stated = {key: truth[key] for key in ("class_map", "velocity_mps")}
        if isinstance(stated["velocity_mps"], Mapping):
            stated["velocity_mps"] = f"of each frame, {digest_of(self._velocity_mps)}"
        self.mask = f"{self._mask}, {stated}"
        self.unseen = frozenset(truth.get("unseen", ()))
        self.dataset, self.samples = self._truth.name, self._truth.samples
        self.facts: Mapping[str, object] = {"name": folder.name}

    def _velocities(self, stated: Sequence | Mapping, root: Path) -> dict[str, Sequence[float]]:
        """Returns the velocity of every frame, which ``layout.json`` may give one by one."""
        frames = ["/".join(sample) for sample in self._truth.samples]
        velocities = stated if isinstance(stated, Mapping) else dict.fromkeys(frames, stated)
        if missing := [frame for frame in frames if frame not in velocities]:
            raise UserError(f"{root / LAYOUT}: velocity_mps: has no {missing[0]}; add it")
        return dict(velocities)

    def inventory(self) -> Inventory:
        return self._predictions.inventory(self.samples)

    def has(self, sample: Sample) -> bool:
        return not self._predictions.problem_of(*sample)

    def frame(self, sample: Sample) -> tuple[Tensor, dict, None]:
        """Returns predicted labels and their target, batches of one; there are no logits."""
        velocity_mps = self._velocity_mps["/".join(sample)]
        truth = {
            "clip": [sample[0]],
            "semantics": self._truth.labels(*sample)[None],
            "velocity_mps": torch.tensor([velocity_mps], dtype=torch.float64),
        }
        if self._masked:
            names = {"mask": self._mask, "visible": self._format.visible}
            truth |= {key: self._truth.mask(*sample, name)[None] for key, name in names.items()}
        return self._predictions.labels(*sample)[None], truth, None


def _stated(of: LabelFormat, layout: dict, root: Path) -> dict:
    """Returns what a folder's ``layout.json``, or else the configuration, says of its labels.

    Raises `UserError` for what neither says.
    """
    truth = layout | layout_beside(root, of.name)
    if truth.get("class_map") is None and "classes" in layout:
        truth["class_map"], general = class_map_of(root, layout["classes"])
        if general:
            say(f"classes that are general here: {', '.join(sorted(general))}")

    for key in ("class_map", "grid", "velocity_mps"):
        if truth.get(key) is None:
            raise UserError(
                f"layout.{key}: files of {of.name} do not say it; state the one to take"
            )
    return truth


Pairing = SkyShieldPairing | FormatPairing


class _Layouts(dict[str, type[Pairing]]):
    def __missing__(self, name: str) -> type[Pairing]:
        raise UserError(
            f"layout.name: {name!r}{closest(str(name), self)} there are {', '.join(self)}"
        )


LAYOUTS = _Layouts(skyshield=SkyShieldPairing, **dict.fromkeys(LABEL_FORMATS, FormatPairing))
