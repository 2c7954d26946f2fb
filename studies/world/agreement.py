"""Labels against true surfaces: counts that add up over frames, and the shares made of them."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Bool, UInt8

from src.ontology import CAR, CLASSES, FREE, LARGE_VEHICLE, OCCUPIED, UNKNOWN, VRU
from studies.world.truth import OfClasses, SurfaceTruth

MOVING = (LARGE_VEHICLE, CAR, VRU)
SCOPES = ("visible", "supervised")

# Of the classes, and of all together. `SurfaceAgreement` says what each counts.
COUNTS = ["true", "found", "named", "labelled", "right", "right_name", "ghosts", "free"]
COUNTS += ["free_wrong"]
ALL = "all"

Voxels = Bool[np.ndarray, "X Y Z"]
Labels = UInt8[np.ndarray, "X Y Z"]


def _no_counts() -> pd.DataFrame:
    rows = [*(CLASSES[k] for k in OCCUPIED), ALL]
    index = pd.MultiIndex.from_product([SCOPES, rows], names=["scope", "class"])
    return pd.DataFrame(0, index=index, columns=COUNTS, dtype=np.int64)


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
    counts: pd.DataFrame = field(default_factory=_no_counts)

    def add(self, semantics: Labels, truth: SurfaceTruth) -> None:
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
        self.counts += other.counts

    def _add(
        self, scope: str, semantics: Labels, truth: SurfaceTruth, surfaces: OfClasses, air: Voxels
    ) -> None:
        """Counts a frame's ``surfaces``, the labels there, and those in the open ``air``."""
        occupied, labelled = semantics < FREE, semantics[..., None] == np.array(OCCUPIED)
        true, in_scope = truth.holds & surfaces, surfaces.any(axis=-1) | air
        own, holds_any = labelled & in_scope[..., None], truth.holds.any(axis=-1)
        of_classes = {
            "true": true,
            "found": true & occupied[..., None],
            "named": true & own,
            "labelled": own,
            "right": own & holds_any[..., None],
            "right_name": own & truth.holds,
            "ghosts": own & ~truth.touches,
        }

        # A voxel has one label, but may hold several classes: true ones do not add up.
        any_true, free = true.any(axis=-1), (semantics == FREE) & air
        of_all = {
            **{name: voxels.any(axis=-1) for name, voxels in of_classes.items()},
            "named": any_true & (labelled & truth.holds).any(axis=-1),
            "free": free,
            "free_wrong": free & holds_any,
        }
        rows = {
            CLASSES[k]: {name: voxels[..., k] for name, voxels in of_classes.items()}
            for k in OCCUPIED
        }
        for row, voxels in {**rows, ALL: of_all}.items():
            self.counts.loc[(scope, row), list(voxels)] += [each.sum() for each in voxels.values()]

    def table(self) -> pd.DataFrame:
        """Returns counts and shares by scope and class; shares are NaN where there is nothing.

        ``recall`` is found / true, ``class_recall`` named / true, ``precision`` right / labelled,
        ``class_precision`` right_name / labelled, ``free_error`` free_wrong / free.
        """
        table = self.counts.reset_index()
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
        return int(self.counts.loc["visible"].loc[rows, "ghosts"].sum())
