"""How the intervals of a table were drawn, from how much, and what they cannot say."""

from collections.abc import Mapping, Sequence

from ..results.table import Resamples

ONE_SEED = (
    "With one seed only clips are drawn: nothing is said of how far another training would have "
    "moved a score"
)
# With fewer seeds or clips than this, percentiles of resamples are coarse.
FEW = 10


def resampling(resamples: Resamples, experiments: Sequence[str], differences: bool = False) -> str:
    """Says how the intervals of a table of some experiments on one set of clips were drawn."""
    seeds = {name: resamples.seeds(name) for name in experiments}
    most, clips = max(map(len, seeds.values()), default=0), resamples.clips
    listed = listed_seeds(seeds, differences)
    if most < 2 and clips < 2:
        return f"No intervals: there is one seed and one clip to draw from. {listed}"

    drawn = [f"{most} seeds"] if most > 1 else []
    drawn += [f"{clips} clips ({resamples.frames} frames)"] if clips > 1 else []
    text = (
        f"{intervals_over(resamples)} {' and, independently, '.join(drawn)}, the same for every row"
    )
    if min(n for n in (most, clips) if n > 1) < FEW:
        text += "; from so few they are coarse, and rather too narrow"
    if most < 2:
        text += f". {ONE_SEED}"
    elif clips < 2:
        text += ". There is one clip, so only seeds are drawn"
    return f"{text}. {lost_classes(resamples)}{listed}"


def intervals_over(resamples: Resamples) -> str:
    """Returns the beginning of the sentence that says what was resampled."""
    return (
        f"In brackets: {100 * resamples.level:g} % percentile intervals over "
        f"{resamples.resamples:,} resamples of"
    )


def lost_classes(*columns: Resamples) -> str:
    """Says how often resamples miss a class, where they do: it may move their means."""
    share = max(resamples.lost for resamples in columns)
    if not share:
        return ""
    at_most = "up to " if len(columns) > 1 else ""
    return (
        f"In {at_most}{100 * share:.2g} % of the resamples no voxel of some class is drawn: the "
        "means leave it out, or count it as 0 where it was predicted. "
    )


def listed_seeds(seeds: Mapping[str, Sequence[int]], differences: bool) -> str:
    """Lists the seeds of experiments; in one list where all have the same."""
    texts = {name: ", ".join(map(str, of_one)) for name, of_one in seeds.items()}
    if len(set(texts.values())) == 1:
        text = next(iter(texts.values()))
        return f"Seeds: {text}." if "," in text else f"Seed: {text}."

    lists = "; ".join(f"{name} {text}" for name, text in texts.items())
    over = " Differences are over the seeds that both rungs have." if differences else ""
    return f"Seeds: {lists}.{over}"


def counted(number: int, noun: str) -> str:
    """Returns a number and its noun, in the plural where that is due."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
