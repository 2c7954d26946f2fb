"""Predictions beside their ground truth, in our layout or in Occ3D's."""

from collections.abc import Mapping
from pathlib import Path

import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from ..data.occ3d import MASKS, Occ3DFolder
from ..data.predictions import FACTS, Inventory, Predictions
from ..data.truth import SkyShieldTruth
from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_choice
from ..metrics.protocol import SUPERVISED, VISIBLE
from .dataset import root_of

Sample = tuple[str, int] | tuple[str, str]


class SkyShieldPairing:
    """Predictions and ground truth in the layout of this project."""

    def __init__(self, cfg: DictConfig, folder: Path, part: str) -> None:
        require_choice("layout.mask", cfg.layout.mask, ("supervised", "visible"))
        root = Path(cfg.dataset) if cfg.dataset else root_of(cfg)
        self._predictions = Predictions(folder)
        self.dataset, self.facts = root.name, self._predictions.facts
        if self.facts.get("dataset", self.dataset) != self.dataset:
            raise UserError(
                f"{folder}: these are predictions of {self.facts['dataset']}, not of "
                f"{self.dataset}; name the dataset that they were made on, as dataset=DIR"
            )

        self._truth = SkyShieldTruth(root, part, _held_out(self.facts, folder))
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


class Occ3DPairing:
    """Predictions and ground truth in Occ3D's layout; the configuration states the rest."""

    unseen: frozenset[str] = frozenset()

    def __init__(self, cfg: DictConfig, folder: Path, part: str) -> None:
        layout = OmegaConf.to_container(cfg.layout, resolve=True)
        for key in ("class_map", "grid", "velocity_mps"):
            if layout.get(key) is None:
                raise UserError(f"layout.{key}: Occ3D's files do not say it; state the one to take")
        if cfg.dataset is None:
            raise UserError("dataset: name the folder with Occ3D's labels, as dataset=DIR")

        require_choice("layout.mask", layout["mask"], (*MASKS, "supervised"))

        self.grid = VoxelGrid(**layout["grid"])
        self._truth = Occ3DFolder(Path(cfg.dataset), layout["class_map"], self.grid)
        self._predictions = Occ3DFolder(folder, layout["class_map"], self.grid)
        self._velocity = torch.tensor([layout["velocity_mps"]], dtype=torch.float64)

        self._mask = layout["mask"]
        # None of this is in Occ3D's files, so that scores depend on what was stated.
        stated = {key: layout[key] for key in ("class_map", "velocity_mps")}
        self.mask = f"{self._mask}, {stated}"
        self.dataset, self.samples = self._truth.name, self._truth.samples
        self.facts: Mapping[str, object] = {"name": folder.name}

    def inventory(self) -> Inventory:
        return self._predictions.inventory(self.samples)

    def has(self, sample: Sample) -> bool:
        return not self._predictions.problem_of(*sample)

    def frame(self, sample: Sample) -> tuple[Tensor, dict, None]:
        """Returns predicted labels and their target, batches of one; Occ3D has no logits."""
        truth = {
            "clip": [sample[0]],
            "semantics": self._truth.labels(*sample)[None],
            "velocity_mps": self._velocity,
        }
        if self._mask in MASKS:
            truth["mask"] = self._truth.mask(*sample, self._mask)[None]
        return self._predictions.labels(*sample)[None], truth, None


Pairing = SkyShieldPairing | Occ3DPairing
LAYOUTS: dict[str, type[Pairing]] = {"skyshield": SkyShieldPairing, "occ3d": Occ3DPairing}
