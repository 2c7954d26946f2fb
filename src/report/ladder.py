"""The ladder: its experiments in their order, their names in the paper, and its three factors.

Each rung of the paper adds one factor to the rung before it (`conf/experiment/`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from ..errors import UserError
from ..run_folder import ANCHORS

# Names of the predictions that never look at the image, scored beside every run.
ANCHOR_NAMES = dict(zip(ANCHORS, ("All free", "Voxel prior", "Height prior")))


class Rung(NamedTuple):
    """``row`` is its name in the main tables, without one that of what it adds.

    ``added`` is the name of what it adds to the rung before, if that has one, and ``factors`` which
    it must have of projection, class weights and Lovász loss; ``None`` where it may be anything.
    """

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
    def reference(self) -> str:
        """The experiment that gains are measured over, in words."""
        return "the baseline" if self.first == PAPER.first else self.row_name(self.first)

    def row_name(self, experiment: str) -> str:
        """Returns the name of an experiment's row in a table."""
        if rung := self.rungs.get(experiment):
            return rung.row or f"+ {rung.added}"
        return ANCHOR_NAMES.get(experiment, experiment)

    def in_order(self, experiments: Iterable[str]) -> list[str]:
        """Returns the rungs from the lowest, and then the others by name."""
        names = set(experiments)
        return [name for name in self.names if name in names] + sorted(names - set(self.names))


# The four experiments of Table 3, and the names of their rows.
PAPER = Ladder(
    {
        "baseline": Rung("Baseline", "", (False, False, False)),
        "attitude": Rung("", "Attitude-aware projection", (True, False, False)),
        "weights": Rung("", "Safety-prior class weights", (True, True, False)),
        "skyocc": Rung("SkyOcc", "Lovász-Softmax", (True, True, True)),
    }
)


def ladder_named(names: Sequence[str]) -> Ladder:
    """Returns the ladder of some experiments, the lowest first; without a name, the paper's.

    Raises `UserError` for a name that is given twice, or is an anchor's.
    """
    for name in names:
        if names.count(name) > 1 or name in ANCHORS:
            raise UserError(
                f"task.rungs: {name} is an anchor, or named twice; name each experiment once"
            )

    # The first rung stands on nothing, in the paper as here.
    steps = {*pairwise([None, *PAPER.names])}
    rungs = {}
    for before, name in pairwise([None, *(names or PAPER.names)]):
        # An experiment that the paper does not have is called by its own name.
        rung = PAPER.rungs.get(name, Rung(name, ""))
        # On another rung than the paper's it has not the name of what it adds there.
        is_a_step = (before, name) in steps
        rungs[name] = rung if is_a_step else rung._replace(row=rung.row or name, added="")

    return Ladder(rungs)
