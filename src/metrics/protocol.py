"""What was counted and how: without it a score of this field means little."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..dotted import differences
from ..errors import UserError
from ..geometry import VoxelGrid
from ..provenance import digest_of

# What no setting changes.
RULES = {
    "miou": "9 classes, free in",
    "miou_occupied": "8 classes, free out",
    "kar_miou": "8 classes, free out",
    "absent_class": "left out of the mean",
    "accumulation": "counts over the data set",
}

# A metric that was once in every suite. Older counts and weights, which name it, are read without.
FORMER = ("sensitivity", "src.metrics.KARSensitivity")

SUPERVISED, VISIBLE = "every supervised voxel", "visible voxels"


@dataclass(frozen=True)
class Protocol:
    """Everything on which a score depends besides the predictions.

    ``metric`` are the arguments of `OccupancyScores`, ``suite`` those of `ScoreSuite`: its
    ``metrics``, each with its class and its arguments, and the settings that they share.
    ``frames`` is their number: of a split, or less where predictions were missing and allowed to,
    or where ``trainer.limit_test_batches`` left some out.
    """

    dataset: str
    part: str
    frames: int
    grid: dict
    mask: str = SUPERVISED
    metric: dict = field(default_factory=dict)
    suite: dict = field(default_factory=dict)
    rules: dict = field(default_factory=lambda: dict(RULES))

    @classmethod
    def of(
        cls,
        dataset: str,
        part: str,
        frames: int,
        grid: VoxelGrid,
        mask: str,
        metric: Mapping[str, Any],
        suite: Mapping[str, Any],
    ) -> "Protocol":
        """Describes settings as they are configured; keys of ``metric`` that begin with ``_`` are
        Hydra's and stay out."""
        # As JSON has them: lists, not tuples.
        sides = {name: list(value) for name, value in dataclasses.asdict(grid).items()}
        arguments = {key: value for key, value in metric.items() if not key.startswith("_")}
        return cls(dataset, part, frames, sides, mask, arguments, dict(suite))

    @classmethod
    def from_json(cls, text: str) -> "Protocol":
        """Reads what `to_json` wrote. Raises `UserError` for any other text."""
        try:
            protocol = cls(**json.loads(text))
            return dataclasses.replace(protocol, suite=without_former(protocol.suite))
        except (ValueError, TypeError, AttributeError) as error:
            raise UserError(f"protocol: cannot be read ({error})") from error

    def to_json(self, indent: int | None = None) -> str:
        """Returns JSON with sorted keys: equal protocols have equal texts."""
        separators = (",", ":") if indent is None else None
        return json.dumps(
            dataclasses.asdict(self), sort_keys=True, separators=separators, indent=indent
        )

    @property
    def digest(self) -> str:
        """Twelve digits that name the protocol, in tables and as the name of its file."""
        return digest_of(self.to_json())

    @property
    def voxel_grid(self) -> VoxelGrid:
        return VoxelGrid(**self.grid)

    def difference(self, other: "Protocol") -> tuple[str, object, object] | None:
        """Returns the first key in which two protocols differ, and both values; ``None`` if they
        are equal. A metric that one of them alone has changes no score of the others."""
        changed = differences(self._beside(other), other._beside(self))
        # Last what a metric says of itself: a shared setting is named where it is set.
        return min(changed, key=lambda each: each[0].startswith("suite.metrics."), default=None)

    def _beside(self, other: "Protocol") -> dict:
        """Returns plain data, with no metric and no setting of metrics that the other has not."""
        own = json.loads(self.to_json())
        metrics = other.suite.get("metrics", {})
        own["suite"] = {key: each for key, each in own["suite"].items() if key in other.suite}
        if "metrics" in own["suite"]:
            kept = {name: each for name, each in own["suite"]["metrics"].items() if name in metrics}
            own["suite"]["metrics"] = kept
        return own


def without_former(suite: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a suite without a metric that has left the suites (`FORMER`)."""
    name, target = FORMER
    metrics = suite.get("metrics", {})
    if metrics.get(name, {}).get("_target_") != target:
        return dict(suite)
    kept = {key: value for key, value in suite.items() if key != name}
    return kept | {"metrics": {key: value for key, value in metrics.items() if key != name}}


def require_same_protocol(protocols: Mapping[str, Protocol]) -> None:
    """Refuses to put scores of different protocols beside each other, naming what differs."""
    (first, reference), *others = protocols.items()
    for name, protocol in others:
        if difference := reference.difference(protocol):
            key, one, other = difference
            raise UserError(
                f"{name}: was scored with {key}={other}, and {first} with {one}; score both alike"
            )
