"""What was scored on one part of the test split, and how its intervals are to be read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .evidence import Evidence
from .ladder import ANCHORS, PAPER, Ladder

ONE_SEED = (
    "With one seed only clips are drawn: nothing is said of how far another training would have "
    "moved a score"
)
FEW = 10
"""With fewer seeds or clips than this, percentiles of resamples are coarse."""


@dataclass(frozen=True)
class ScoredPart:
    """Evidence on a part of the test split of a data set.

    ``label`` tells its rows from those of another protocol, where a mixed report has several.
    """

    name: str
    dataset: str
    evidence: Evidence
    label: str = ""
    ladder: Ladder = PAPER

    @property
    def rungs(self) -> list[str]:
        """The experiments of the ladder that are there."""
        return [name for name in self.ladder.names if self.evidence.seeds(name)]

    @property
    def others(self) -> list[str]:
        """The experiments that are no rung, the anchors aside."""
        known = {*self.ladder.names, *ANCHORS}
        return sorted(name for name in self.evidence.samples if name not in known)

    @property
    def anchors(self) -> list[str]:
        return [name for name in ANCHORS if self.evidence.seeds(name)]

    @property
    def suffix(self) -> str:
        """Of the keys of its tables; those of the whole split have none."""
        return "" if self.name == "test" else f"_{self.name}"

    @property
    def where(self) -> str:
        return f"{self.name} of {self.dataset}{self.label}"

    def resampling(self, experiments: Sequence[str], differences: bool = False) -> str:
        """How the intervals of a table were drawn, from how much, and what they cannot say."""
        seeds = {name: tuple(self.evidence.seeds(name)) for name in experiments}
        most, clips = max(map(len, seeds.values()), default=0), self.evidence.clips
        listed = listed_seeds(seeds, differences)
        if most < 2 and clips < 2:
            return f"No intervals: there is one seed and one clip to draw from. {listed}"
        drawn = [f"{most} seeds"] * (most > 1)
        drawn += [f"{clips} clips ({self.evidence.frames} frames)"] * (clips > 1)
        said = (
            f"In brackets: {100 * self.evidence.level:g} % percentile intervals over "
            f"{self.evidence.resamples:,} resamples of {' and, independently, '.join(drawn)}, the "
            "same for every row"
        )
        if min(n for n in (most, clips) if n > 1) < FEW:
            said += "; from so few they are coarse, and rather too narrow"
        if most < 2:
            said += f". {ONE_SEED}"
        elif clips < 2:
            said += ". There is one clip, so only seeds are drawn"
        return f"{said}. {lost_classes(self.evidence)}{listed}"


def lost_classes(*columns: Evidence) -> str:
    """How often resamples miss a class, where they do: it may move their means."""
    share = max(evidence.lost for evidence in columns)
    if not share:
        return ""
    at_most = "up to " if len(columns) > 1 else ""
    return (
        f"In {at_most}{100 * share:.2g} % of the resamples no voxel of some class is drawn: the "
        "means leave it out, or count it as 0 where it was predicted. "
    )


def listed_seeds(seeds: Mapping[str, tuple[int, ...]], differences: bool) -> str:
    """The seeds of experiments; one list where all have the same."""
    texts = {name: ", ".join(map(str, of_one)) for name, of_one in seeds.items()}
    if len(set(texts.values())) == 1:
        text = next(iter(texts.values()))
        return f"Seed{'s' * (',' in text)}: {text}."
    lists = "; ".join(f"{name} {text}" for name, text in texts.items())
    over = " Differences are over the seeds that both rungs have." if differences else ""
    return f"Seeds: {lists}.{over}"
