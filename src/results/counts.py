"""The integer tables of one scored run, clip by clip, from which every score is computed again."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..atomic import replacing
from ..data.files import BROKEN
from ..errors import UserError, way_out_of
from ..metrics.count_metric import NamedCounts, Scores
from ..metrics.protocol import Protocol, require_same_protocol
from ..metrics.suite import STANDARD, ScoreSuite
from ..run_folder import UNKNOWN_RECIPE
from .bootstrap import Samples, score_samples

FORMAT = 1
OTHER_LABELS = "other labels"
AGAIN = "give the command of its run again, which scores it, or task=score for predictions"

# Parts of a split by their names, each of which says whether a clip belongs to it.
Parts = Mapping[str, Callable[[str], bool]]


def parts_of(unseen: Collection[str]) -> Parts:
    """Returns the test split and its parts: clips never trained on, and last seconds of others."""
    return {
        "test": lambda clip: True,
        "test_unseen_clips": lambda clip: clip in unseen,
        "test_seen_clips": lambda clip: clip not in unseen,
    }


@dataclass(frozen=True)
class Counts:
    """Integer tables [clips, ...] of every metric, the clips in their order, and the protocol.

    ``frames`` holds the number of scored frames of each clip. ``name`` says whose predictions were
    counted, and ``recipe`` how their network was trained.
    """

    name: str
    protocol: Protocol
    clips: list[str]
    frames: list[int]
    tables: dict[str, NamedCounts]
    recipe: str = UNKNOWN_RECIPE

    @classmethod
    def of(
        cls,
        name: str,
        protocol: Protocol,
        suite: ScoreSuite,
        samples: Sequence[tuple[str, object]],
        recipe: str = UNKNOWN_RECIPE,
    ) -> "Counts":
        """Returns the counts of a suite over all samples, which begin with their clips."""
        frames = Counter(clip for clip, _ in samples)
        of_clips = [frames[clip] for clip in suite.clips]
        return cls(name, protocol, suite.clips, of_clips, suite.counts(), recipe)

    def suite(self) -> ScoreSuite:
        """Returns the metrics that compute scores from the tables."""
        return ScoreSuite.of(self.protocol, self.clips)

    @property
    def own_scores(self) -> list[str]:
        """The names of the scores of metrics that are not among this project's (`STANDARD`)."""
        suite = self.suite()
        metrics = [suite.metric(name) for name in self.tables if name not in STANDARD]
        shown = [metric for metric in metrics if metric.in_score_table]
        return [score for metric in shown for score in metric.scores(metric.counts)]

    def rows(self, chosen: Callable[[str], bool] = lambda clip: True) -> list[int]:
        """Returns the rows of the chosen clips that have a frame."""
        return [n for n, clip in enumerate(self.clips) if self.frames[n] and chosen(clip)]

    def scores(self, metric: str, rows: list[int] | None = None) -> Scores:
        """Returns every score of one metric over some rows together; all rows without ``rows``."""
        rows = self.rows() if rows is None else rows
        summed = {name: table[rows].sum(0) for name, table in self.tables[metric].items()}

        return self.suite().metric(metric).scores(summed)

    def samples(
        self, rows: list[int], weights: Float[Tensor, "r n"], without: Collection[str] = ()
    ) -> dict[str, Samples]:
        """Returns the scores of each metric but those ``without``: of n rows, and of r resamples,
        which draw each row as often as ``weights`` say."""
        suite, samples = self.suite(), {}
        for name, tables in self.tables.items():
            metric = suite.metric(name)
            if metric.in_score_table and name not in without:
                chosen = {key: table[rows].cpu() for key, table in tables.items()}
                samples[name] = score_samples(metric, chosen, weights)
        return samples

    def of_clips(self, chosen: Callable[[str], bool]) -> "Counts":
        """Returns the counts of the chosen clips that have a frame, which may be none."""
        rows = self.rows(chosen)
        tables = {
            metric: {name: table[rows] for name, table in tables.items()}
            for metric, tables in self.tables.items()
        }
        clips, frames = ([column[row] for row in rows] for column in (self.clips, self.frames))

        return replace(self, clips=clips, frames=frames, tables=tables)

    def scored_on_other(self, other: "Counts") -> str:
        """Says in what the scored data differ: clips, frames, or labels; empty where they agree.

        Labels are compared as far as counts can tell, as in `unlike_labels`.
        """
        if (self.clips, self.frames) != (other.clips, other.frames):
            return "other clips or frames"
        return OTHER_LABELS if self.unlike_labels(other) else ""

    def unlike_labels(self, other: "Counts") -> float:
        """Returns the share of voxels that other counts of the same clips label otherwise, by the
        voxels of each class in each clip; there may be more."""
        # The sum over predictions leaves the labels alone.
        labels, other_labels = (each.tables["occupancy"]["count"].sum(-1) for each in (self, other))
        return int((labels - other_labels).abs().sum()) / 2 / max(int(labels.sum()), 1)

    def write(self, path: Path, compressed: bool = True) -> None:
        """Writes an ``.npz`` of plain arrays; the file is replaced as a whole or not at all."""
        arrays = {
            f"{metric}/{name}": table.cpu().numpy()
            for metric, tables in self.tables.items()
            for name, table in tables.items()
        }
        save = np.savez_compressed if compressed else np.savez

        with replacing(path) as temporary, open(temporary, "wb") as file:
            save(
                file,
                format=np.array(FORMAT),
                name=np.array(self.name),
                protocol=np.array(self.protocol.to_json()),
                recipe=np.array(self.recipe),
                clips=np.array(self.clips),
                frames=np.array(self.frames, dtype=np.int64),
                **arrays,
            )

    @classmethod
    def read(cls, path: Path) -> "Counts":
        """Reads a file of `write`. Raises `UserError` for one that is missing or anything else."""
        tables: dict[str, NamedCounts] = {}
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            if int(arrays.pop("format")) != FORMAT:
                raise ValueError("it is of another version")

            name, protocol = (str(arrays.pop(key)) for key in ("name", "protocol"))
            recipe = str(arrays.pop("recipe", UNKNOWN_RECIPE))
            clips, frames = (arrays.pop(key).tolist() for key in ("clips", "frames"))
            described = Protocol.from_json(protocol)
            for key, array in arrays.items():
                metric, table = key.split("/", 1)
                if metric in described.suite.get("metrics", [metric]):
                    tables.setdefault(metric, {})[table] = torch.from_numpy(array)
            return cls(name, described, clips, frames, tables, recipe)
        except FileNotFoundError as error:
            raise UserError(f"{path}: no such file; {AGAIN}") from error
        # numpy raises the last two over the header of an array.
        except (*BROKEN, SyntaxError, TokenError) as error:
            reason = " ".join(str(error).split())
            way_out = way_out_of(error, f"move it away and {AGAIN}", path)
            raise UserError(f"{path}: cannot be read ({reason}); {way_out}") from error


def require_comparable(counts: Mapping[str, Counts], way_out: str = "score both alike") -> None:
    """Raises `UserError` for counts of other protocols, clips, frames or labels than the first's.

    They are given by the names that a message calls them; ``way_out`` ends it.
    """
    require_same_protocol({name: each.protocol for name, each in counts.items()})
    (first, reference), *others = counts.items()
    for name, each in others:
        if other := each.scored_on_other(reference):
            raise UserError(f"{name}: was scored on {other} than {first}; {way_out}")
