"""Labels against the truth: counts that add up over frames, and the scores made of them."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Bool, UInt8

from ..ontology import CAR, CLASSES, FREE, LARGE_VEHICLE, OCCUPIED, UNKNOWN, VRU
from .truth import Truth

MOVING = (LARGE_VEHICLE, CAR, VRU)
SCOPES = ("visible", "supervised")
COUNTS = (
    *("true", "found", "named", "labelled", "right", "right_name", "ghosts"),
    *("free", "free_wrong"),
)


@dataclass
class Agreement:
    """Counts of voxels by scope, and by class with one more row for all classes together.

    Scope ``visible``: surfaces that the camera truly sees, in voxels whose centre is in the image;
    labels there; and free labels to whose centre it truly sees. What is not labelled there counts
    as missed. Scope ``supervised``: all labelled voxels, seen or not.

    ``true`` voxels hold the class (a surface over 1 % of a voxel's face); of these, ``found`` are
    labelled occupied and ``named`` with the class. ``labelled`` voxels carry the class; of these,
    ``right`` truly hold some surface, ``right_name`` the class's own, and ``ghosts`` have nothing
    of it within 1 mm. ``free`` voxels are labelled free, ``free_wrong`` of them hold a surface.
    """

    frames: int = 0
    counts: dict[str, pd.DataFrame] = field(
        default_factory=lambda: {scope: _no_counts() for scope in SCOPES}
    )

    def add(self, semantics: UInt8[np.ndarray, "X Y Z"], truth: Truth) -> None:
        """Counts one frame."""
        self.frames += 1
        seen = truth.seen & truth.inside[..., None]
        self._add("visible", semantics, truth, truth.holds & seen, seen, truth.centre_seen)
        known = semantics != UNKNOWN
        every = np.broadcast_to(known[..., None], truth.holds.shape)
        self._add("supervised", semantics, truth, truth.holds & every, every, known)

    def join(self, other: "Agreement") -> None:
        """Adds the counts of other frames."""
        self.frames += other.frames
        for scope in SCOPES:
            self.counts[scope] += other.counts[scope]

    def _add(
        self,
        scope: str,
        semantics: UInt8[np.ndarray, "X Y Z"],
        truth: Truth,
        true: Bool[np.ndarray, "X Y Z 8"],
        surfaces: Bool[np.ndarray, "X Y Z 8"],
        open_space: Bool[np.ndarray, "X Y Z"],
    ) -> None:
        counts, occupied = self.counts[scope], semantics < FREE
        holds_any, in_scope = truth.holds.any(axis=-1), surfaces.any(axis=-1) | open_space
        for k in OCCUPIED:
            own = (semantics == k) & in_scope
            row = CLASSES[k]
            counts.loc[row, "true"] += true[..., k].sum()
            counts.loc[row, "found"] += (true[..., k] & occupied).sum()
            counts.loc[row, "named"] += (true[..., k] & own).sum()
            counts.loc[row, "labelled"] += own.sum()
            counts.loc[row, "right"] += (own & holds_any).sum()
            counts.loc[row, "right_name"] += (own & truth.holds[..., k]).sum()
            counts.loc[row, "ghosts"] += (own & ~truth.touches[..., k]).sum()
        free = (semantics == FREE) & open_space
        any_true, label = true.any(axis=-1), np.minimum(semantics, FREE - 1)
        name_true = np.take_along_axis(truth.holds, label[..., None].astype(int), axis=-1)[..., 0]
        every = {
            "true": any_true,
            "found": any_true & occupied,
            "named": any_true & occupied & name_true,
            "free": free,
            "free_wrong": free & holds_any,
        }
        for name, voxels in every.items():
            counts.loc["all", name] += voxels.sum()
        for name in ("labelled", "right", "right_name", "ghosts"):
            counts.loc["all", name] = counts.loc[[CLASSES[k] for k in OCCUPIED], name].sum()

    def table(self) -> pd.DataFrame:
        """The scores by scope and class, one row each; shares are NaN where there is nothing.

        ``recall`` is found / true, ``class_recall`` named / true, ``precision`` right / labelled,
        ``class_precision`` right_name / labelled, ``free_error`` free_wrong / free.
        """
        tables = []
        for scope, counts in self.counts.items():
            table = counts.copy()
            table["recall"] = counts["found"] / counts["true"]
            table["class_recall"] = counts["named"] / counts["true"]
            table["precision"] = counts["right"] / counts["labelled"]
            table["class_precision"] = counts["right_name"] / counts["labelled"]
            table["free_error"] = counts["free_wrong"] / counts["free"]
            table.insert(0, "scope", scope)
            tables.append(table.rename_axis("class").reset_index())
        return pd.concat(tables, ignore_index=True)

    @property
    def moving_ghosts(self) -> int:
        """Visible voxels labelled as a moving class where nothing of it is within 1 mm."""
        rows = [CLASSES[k] for k in MOVING]
        return int(self.counts["visible"].loc[rows, "ghosts"].sum())


def _no_counts() -> pd.DataFrame:
    rows = [*(CLASSES[k] for k in OCCUPIED), "all"]
    return pd.DataFrame(0, index=rows, columns=list(COUNTS), dtype=np.int64)
