"""The ladder: its four experiments in their order, their names in the paper, and its three factors.

A rung adds one factor to the one before it (`conf/experiment/`).
"""

from collections.abc import Mapping
from typing import NamedTuple


class Rung(NamedTuple):
    """``row`` is its name in the paper's main tables, ``added`` what it adds to the rung before,
    and ``factors`` which of `FACTORS` it has."""

    row: str
    added: str
    factors: tuple[bool, bool, bool]


LADDER = {
    "baseline": Rung("Baseline", "", (False, False, False)),
    "attitude": Rung(
        "+ Attitude-aware projection", "Attitude-aware projection", (True, False, False)
    ),
    "weights": Rung(
        "+ Safety-prior class weights", "Safety-prior class weights", (True, True, False)
    ),
    "skyocc": Rung("SkyShield", "Lovász-Softmax", (True, True, True)),
}
"""By experiment, the lowest rung first."""

FIRST, LAST = next(iter(LADDER)), list(LADDER)[-1]
FACTORS = ("model.encoder.projection", "loss.class_weights", "loss.lovasz_weight")
"""Where a run's configuration says which of the factors it has."""

ANCHORS = {"all_free": "All free", "voxel_prior": "Voxel prior"}
"""Predictions that never look at the image, scored beside every run."""


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


def row_name(experiment: str) -> str:
    """What a row of a table is called."""
    rung = LADDER.get(experiment)
    return rung.row if rung else ANCHORS.get(experiment, experiment)


def in_order(experiments: Mapping | list[str]) -> list[str]:
    """The ladder's rungs from the lowest, and then the others by name."""
    others = sorted(name for name in experiments if name not in LADDER)
    return [name for name in LADDER if name in experiments] + others
