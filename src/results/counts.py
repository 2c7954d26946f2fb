"""The integer tables of one scored run, clip by clip, from which every score is computed again."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError

import numpy as np
import torch

from ..atomic import replacing
from ..data.files import BROKEN
from ..errors import UserError
from ..metrics.count_metric import NamedCounts, Scores
from ..metrics.protocol import Protocol, require_same_protocol
from ..metrics.suite import ScoreSuite

FORMAT = 1
OTHER_LABELS = "other labels"
AGAIN = "give the command of its run again, which scores it, or task=score for predictions"


@dataclass(frozen=True)
class Counts:
    """Integer tables [clips, ...] of every metric, the clips in their order, and the protocol.

    ``frames`` holds the number of scored frames of each clip. ``name`` says whose predictions were
    counted.
    """

    name: str
    protocol: Protocol
    clips: list[str]
    frames: list[int]
    tables: dict[str, NamedCounts]

    def suite(self) -> ScoreSuite:
        """Returns the metrics that compute scores from the tables."""
        return ScoreSuite.of(self.protocol, self.clips)

    def rows(self, chosen: Callable[[str], bool] = lambda clip: True) -> list[int]:
        """Returns the rows of the chosen clips that have a frame."""
        return [n for n, clip in enumerate(self.clips) if self.frames[n] and chosen(clip)]

    def scores(self, metric: str, rows: list[int] | None = None) -> Scores:
        """Returns every score of one metric over some rows together; all rows without ``rows``."""
        rows = self.rows() if rows is None else rows
        summed = {name: table[rows].sum(0) for name, table in self.tables[metric].items()}

        return self.suite().metric(metric).scores(summed)

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
            clips, frames = (arrays.pop(key).tolist() for key in ("clips", "frames"))
            described = Protocol.from_json(protocol)
            for key, array in arrays.items():
                metric, table = key.split("/", 1)
                if metric in described.suite.get("metrics", [metric]):
                    tables.setdefault(metric, {})[table] = torch.from_numpy(array)
            return cls(name, described, clips, frames, tables)
        except FileNotFoundError as error:
            raise UserError(f"{path}: no such file; {AGAIN}") from error
        # numpy raises the last two over the header of an array.
        except (*BROKEN, SyntaxError, TokenError) as error:
            reason = " ".join(str(error).split())
            raise UserError(f"{path}: cannot be read ({reason}); delete it and {AGAIN}") from error


def require_same_frames(
    first: Path, of_first: Counts, path: Path, counts: Counts, way_out: str
) -> None:
    """Raises `UserError` where two files have counts of other protocols or other frames."""
    protocols = {first: of_first.protocol, path: counts.protocol}
    require_same_protocol({str(each): protocol for each, protocol in protocols.items()})
    if other := counts.scored_on_other(of_first):
        raise UserError(f"{path}: was scored on {other} than {first}; {way_out}")
