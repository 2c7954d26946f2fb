"""The integer tables of a scored run, clip by clip, on disk: all scores can be computed again."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tokenize import TokenError

import numpy as np
import torch

from ..atomic import replacing
from ..data.files import BROKEN
from ..errors import UserError
from .protocol import Protocol
from .suite import ScoreSuite
from .tables import Tables

FORMAT = 1
AGAIN = "give the command of its run again, which scores it, or task=score for predictions"


@dataclass(frozen=True)
class Tally:
    """Tables [clips, ...] of every metric, the clips in their order, and the protocol.

    ``frames`` counts each clip's scored frames. ``name`` says whose predictions these are.
    """

    name: str
    protocol: Protocol
    clips: list[str]
    frames: list[int]
    tables: dict[str, Tables]

    def suite(self) -> ScoreSuite:
        """The metrics that say what the tables mean."""
        return ScoreSuite.of(self.protocol, self.clips)

    def rows(self, chosen: Callable[[str], bool] = lambda clip: True) -> list[int]:
        """Rows of the chosen clips that have a frame."""
        return [n for n, clip in enumerate(self.clips) if self.frames[n] and chosen(clip)]

    def of_clips(self, chosen: Callable[[str], bool]) -> "Tally":
        """The same of the chosen clips that have a frame, which may be none."""
        rows = self.rows(chosen)
        tables = {
            metric: {name: table[rows] for name, table in tables.items()}
            for metric, tables in self.tables.items()
        }
        clips, frames = ([column[row] for row in rows] for column in (self.clips, self.frames))
        return replace(self, clips=clips, frames=frames, tables=tables)

    def scored_on_other(self, tally: "Tally") -> str:
        """What this one counted that the other did not: clips, frames, or labels as far as counts
        can tell, where a clip has other numbers of voxels of the classes. Empty for the same."""
        if (self.clips, self.frames) != (tally.clips, tally.frames):
            return "other clips or frames"
        # What was predicted plays no part in them.
        ours, theirs = (each.tables["occupancy"]["count"].sum(-1) for each in (self, tally))
        return "" if torch.equal(ours, theirs) else "other labels"

    def write(self, path: Path) -> None:
        """Write an ``.npz`` of plain arrays; the file is replaced as a whole or not at all."""
        arrays = {
            f"{metric}/{name}": table.cpu().numpy()
            for metric, tables in self.tables.items()
            for name, table in tables.items()
        }
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(
                file,
                format=np.array(FORMAT),
                name=np.array(self.name),
                protocol=np.array(self.protocol.to_json()),
                clips=np.array(self.clips),
                frames=np.array(self.frames, dtype=np.int64),
                **arrays,
            )

    @classmethod
    def read(cls, path: Path) -> "Tally":
        """What `write` wrote. Raises `UserError` for a file that is missing or anything else."""
        tables: dict[str, Tables] = {}
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            if int(arrays.pop("format")) != FORMAT:
                raise ValueError("it is of another version")
            name, protocol = (str(arrays.pop(key)) for key in ("name", "protocol"))
            clips, frames = (arrays.pop(key).tolist() for key in ("clips", "frames"))
            for key, array in arrays.items():
                metric, table = key.split("/", 1)
                tables.setdefault(metric, {})[table] = torch.from_numpy(array)
            return cls(name, Protocol.from_json(protocol), clips, frames, tables)
        except FileNotFoundError as error:
            raise UserError(f"{path}: no such file; {AGAIN}") from error
        # The last two are what numpy raises over the header of an array.
        except (*BROKEN, SyntaxError, TokenError) as error:
            reason = " ".join(str(error).split())
            raise UserError(f"{path}: cannot be read ({reason}); delete it and {AGAIN}") from error
