"""The ladder: its experiments in their order, their names in the paper, and its three factors.

A rung of the paper adds one factor to the one before it (`conf/experiment/`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from ..errors import UserError

FACTORS = ("model.encoder.projection", "loss.class_weights", "loss.lovasz_weight")
"""Where a run's configuration says which of the factors it has."""

ANCHORS = {"all_free": "All free", "voxel_prior": "Voxel prior"}
"""Predictions that never look at the image, scored beside every run."""


class Rung(NamedTuple):
    """``row`` is its name in the main tables, ``added`` what it adds to the rung before, if that
    has a name, and ``factors`` which of `FACTORS` it must have; ``None`` where it may be
    anything."""

    row: str
    added: str
    factors: tuple[bool, bool, bool] | None = None


@dataclass(frozen=True)
class Ladder:
    """The rungs of a report by experiment, the lowest first. Gains are over the lowest."""

    rungs: Mapping[str, Rung]

    def __contains__(self, experiment: str) -> bool:
        return experiment in self.rungs

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.rungs)

    @property
    def first(self) -> str:
        return self.names[0]

    @property
    def last(self) -> str:
        return self.names[-1]

    @property
    def reference(self) -> str:
        """What gains are over, in words."""
        return "the baseline" if self.first == PAPER.first else self.row_name(self.first)

    def row_name(self, experiment: str) -> str:
        """What a row of a table is called."""
        rung = self.rungs.get(experiment)
        return rung.row if rung else ANCHORS.get(experiment, experiment)

    def in_order(self, experiments: Iterable[str]) -> list[str]:
        """The rungs from the lowest, and then the others by name."""
        there = list(experiments)
        others = sorted(name for name in there if name not in self)
        return [name for name in self.names if name in there] + others


PAPER = Ladder(
    {
        "baseline": Rung("Baseline", "", (False, False, False)),
        "attitude": Rung(
            "+ Attitude-aware projection", "Attitude-aware projection", (True, False, False)
        ),
        "weights": Rung(
            "+ Safety-prior class weights", "Safety-prior class weights", (True, True, False)
        ),
        "skyocc": Rung("SkyOcc", "Lovász-Softmax", (True, True, True)),
    }
)


def ladder_named(names: Sequence[str]) -> Ladder:
    """The ladder of these experiments, the lowest first; without a name, the paper's.

    Raises `UserError` for a name that is there twice, or is an anchor's.
    """
    for name in names:
        if names.count(name) > 1 or name in ANCHORS:
            raise UserError(f"task.rungs: {name} cannot be a rung, or not twice; name experiments")
    if not names:
        return PAPER
    steps = {*pairwise([None, *PAPER.names])}
    return Ladder(
        {name: _rung(name, (before, name) in steps) for before, name in pairwise([None, *names])}
    )


def _rung(name: str, is_a_step: bool) -> Rung:
    """A rung of the paper that stands on the same rung as there has its name and what it adds. On
    another one it keeps the factors, and the name unless that says what was added; what the paper
    does not have is called as its experiment is."""
    rung = PAPER.rungs.get(name, Rung(name, ""))
    if is_a_step:
        return rung
    return rung._replace(row=name if rung.row.startswith("+ ") else rung.row, added="")


def factors_of(config: Mapping) -> tuple[bool, bool, bool]:
    """Which of the ladder's factors a run's configuration has."""
    projection, class_weights, lovasz_weight = (value_at(config, key) for key in FACTORS)
    return projection == "attitude", class_weights is not None, bool(lovasz_weight)


def value_at(config: Mapping, key: str) -> object:
    """The value at a dotted key; ``None`` where there is none."""
    node: object = config
    for name in key.split("."):
        node = node.get(name) if isinstance(node, Mapping) else None
    return node
