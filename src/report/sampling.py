"""The sampling table of a report: seeds, clips, frames and resamples of its intervals."""

from collections.abc import Iterable

from ..ontology import CLASSES
from ..results.render import Table
from ..results.table import AS_RECORDED, Resamples
from ..run_folder import ANCHORS
from .canvas import readable
from .shared_settings import listed

CAPTION = (
    "Percentile intervals over seeds and, independently, clips, the same draws for every row; of a "
    "single seed over clips alone, which says nothing of how far another training would have moved "
    "a score. From fewer than ten seeds or clips they are coarse, and rather too narrow. A "
    "difference is over the seeds that both have. Lost: resamples that draw no voxel of some "
    "class; their means leave it out, or count it as 0 where it was predicted. Blocked: frames "
    "with something in the tube that the body sweeps, on which the collision-miss rate rests. Of "
    "each class: the clips with a labelled voxel; a class without any is left out of a mean, or "
    "counts as 0 where it was predicted."
)


def sampling_table(parts: Iterable[Resamples]) -> Table:
    """Returns a row for each part of the test split, and each condition of its frames."""
    facts = ("clips", "frames", "seeds", "resamples", "interval", "lost", "blocked")
    rows = [(_name(part), _row(part)) for part in parts]
    columns = [*facts, *map(readable, CLASSES)]
    return Table("sampling", "What the intervals rest on", CAPTION, columns, rows, head="Part")


def _name(part: Resamples) -> str:
    return part.part if part.condition == AS_RECORDED else f"{part.part}, {part.condition}"


def _row(part: Resamples) -> list[str]:
    seeds: dict[str, list[str]] = {}
    for name in part.samples:
        if name not in ANCHORS:
            seeds.setdefault(", ".join(map(str, part.seeds(name))), []).append(name)
    frames, clips = part.blocked
    return [
        *(str(part.clips), str(part.frames), listed(seeds) if len(seeds) > 1 else "".join(seeds)),
        *(f"{part.resamples:,}", f"{100 * part.level:g} %", f"{100 * part.lost:.2g} %"),
        f"{frames} in {clips} clips" if "safety" in part.first.tables else "",
        *(str(part.labelled_clips[name]) for name in CLASSES),
    ]
