"""The sampling table of a report: seeds, clips, frames and resamples of its intervals."""

from collections.abc import Iterable

from ..ontology import CLASSES
from ..results.render import Table
from ..results.table import AS_RECORDED, Resamples
from ..run_folder import ANCHORS
from .canvas import readable
from .shared_settings import grouped, listed

CAPTION = (
    "Percentile intervals over seeds and, independently, clips, the same draws for every row; of a "
    "single seed over clips alone. From fewer than ten seeds or clips they are rather too narrow. "
    "Lost: resamples that draw no voxel of some class, which their means leave out. Blocked: "
    "frames with something in the tube that the body sweeps, on which the collision-miss rate "
    "rests. Of each class: the clips with a labelled voxel."
)
FACTS = ("clips", "frames", "seeds", "resamples", "interval", "lost", "blocked")


def sampling_table(parts: Iterable[Resamples]) -> Table:
    """Returns a row for each part of the test split, and each condition of its frames."""
    rows = []
    for part in parts:
        names = [name for name in part.samples if name not in ANCHORS]
        seeds = grouped((", ".join(map(str, part.seeds(name))), name) for name in names)
        frames, clips = part.blocked
        of_seeds = listed(seeds) if len(seeds) > 1 else "".join(seeds)
        facts = [
            *(str(part.clips), str(part.frames), of_seeds),
            *(f"{part.resamples:,}", f"{100 * part.level:g} %", f"{100 * part.lost:.2g} %"),
            f"{frames} in {clips} clips" if "safety" in part.first.tables else "",
            *(str(part.labelled_clips[name]) for name in CLASSES),
        ]

        row = part.part if part.condition == AS_RECORDED else f"{part.part}, {part.condition}"
        rows.append((row, facts))

    columns = [*FACTS, *map(readable, CLASSES)]
    return Table("sampling", "What the intervals rest on", CAPTION, columns, rows, head="Part")
