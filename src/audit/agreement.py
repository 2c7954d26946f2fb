"""Labels against true surfaces: counts that add up over frames, and the shares made of them."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Bool, UInt8

from ..ontology import CAR, CLASSES, FREE, LARGE_VEHICLE, OCCUPIED, UNKNOWN, VRU
from .truth import SurfaceTruth

MOVING = (LARGE_VEHICLE, CAR, VRU)
SCOPES = ("visible", "supervised")

# Of the classes, and of all together. `SurfaceAgreement` says what each counts.
COUNTS = ["true", "found", "named", "labelled", "right", "right_name", "ghosts", "free"]
COUNTS += ["free_wrong"]
ALL = "all"

Voxels = Bool[np.ndarray, "X Y Z"]


def _no_counts() -> pd.DataFrame:
    rows = [*(CLASSES[k] for k in OCCUPIED), ALL]
    return pd.DataFrame(0, index=rows, columns=COUNTS, dtype=np.int64)


@dataclass
class SurfaceAgreement:
    """Counts of voxels by scope, and by class with one more row for all classes together.

    Scope ``visible``: surfaces that the camera truly sees, in voxels whose center is in the image;
    labels there; and free labels to whose center it truly sees. What is not labelled there counts
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

    def add(self, semantics: UInt8[np.ndarray, "X Y Z"], truth: SurfaceTruth) -> None:
        """Counts one frame."""
        self.frames += 1
        seen = truth.seen & truth.inside[..., None]
        self._add("visible", semantics, truth, seen, truth.center_seen)
        known = semantics != UNKNOWN
        every = np.broadcast_to(known[..., None], truth.holds.shape)
        self._add("supervised", semantics, truth, every, known)

    def join(self, other: "SurfaceAgreement") -> None:
        """Adds the counts of other frames."""
        self.frames += other.frames
        for scope in SCOPES:
            self.counts[scope] += other.counts[scope]

    def _add(
        self,
        scope: str,
        semantics: UInt8[np.ndarray, "X Y Z"],
        truth: SurfaceTruth,
        surfaces: Bool[np.ndarray, "X Y Z 8"],
        open_space: Voxels,
    ) -> None:
        """Counts a frame's ``surfaces``, the labels there, and those in the ``open_space``."""
        counts, occupied = self.counts[scope], semantics < FREE
        true, in_scope = truth.holds & surfaces, surfaces.any(axis=-1) | open_space
        holds_any, named_any = truth.holds.any(axis=-1), np.zeros(semantics.shape, dtype=bool)

        for k in OCCUPIED:
            own = (semantics == k) & in_scope
            voxels = {
                "true": true[..., k],
                "found": true[..., k] & occupied,
                "named": true[..., k] & own,
                "labelled": own,
                "right": own & holds_any,
                "right_name": own & truth.holds[..., k],
                "ghosts": own & ~truth.touches[..., k],
            }
            _count(counts, CLASSES[k], voxels)
            named_any |= (semantics == k) & truth.holds[..., k]

        # A voxel has one label, but may hold several classes: true ones do not add up.
        for name in ("labelled", "right", "right_name", "ghosts"):
            counts.loc[ALL, name] = counts[name].drop(ALL).sum()
        any_true, free = true.any(axis=-1), (semantics == FREE) & open_space
        voxels = {"true": any_true, "found": any_true & occupied, "named": any_true & named_any}
        _count(counts, ALL, voxels | {"free": free, "free_wrong": free & holds_any})

    def table(self) -> pd.DataFrame:
        """Returns counts and shares by scope and class; shares are NaN where there is nothing.

        ``recall`` is found / true, ``class_recall`` named / true, ``precision`` right / labelled,
        ``class_precision`` right_name / labelled, ``free_error`` free_wrong / free.
        """
        table = pd.concat(self.counts, names=["scope", "class"]).reset_index()
        table["recall"] = table["found"] / table["true"]
        table["class_recall"] = table["named"] / table["true"]
        table["precision"] = table["right"] / table["labelled"]
        table["class_precision"] = table["right_name"] / table["labelled"]
        table["free_error"] = table["free_wrong"] / table["free"]
        return table[["class", "scope", *table.columns[2:]]]

    @property
    def moving_ghosts(self) -> int:
        """Visible voxels labelled as a moving class where nothing of it is within 1 mm."""
        rows = [CLASSES[k] for k in MOVING]
        return int(self.counts["visible"].loc[rows, "ghosts"].sum())


def _count(counts: pd.DataFrame, row: str, voxels: dict[str, Voxels]) -> None:
    for name, each in voxels.items():
        counts.loc[row, name] += each.sum()
