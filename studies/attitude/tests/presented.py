"""What task=attitude leaves in run folders, with random predictions instead of networks."""

import dataclasses
from functools import cache

import pandas as pd

from src.results.counts import Counts
from studies.attitude.conditions import condition_table, conditions_of
from tests.results.scored import FRAMES, counts, predicted

CONDITIONS = list(conditions_of([5.0], [3.0], [0.2], True, [0.02], [0.01]))
RIGHT = {
    **{"true": 0.5, "tilt_0_5deg": 0.5, "tilt_5_infdeg": 0.3, "noise_3deg": 0.4},
    **{"level": 0.4, "level_tilt_0_5deg": 0.5, "level_tilt_5_infdeg": 0.2},
}
"""Share of the voxels that are predicted as they are; elsewhere 0.2."""
LEVEL_CLIPS = 2
"""So many clips, the first ones, are flown below 5 degrees of tilt, and the others above."""


def frames_of(condition):
    """How many frames of each clip have the tilt of a condition."""
    level = FRAMES[:LEVEL_CLIPS]
    if "tilt_0_5deg" in condition:
        return [*level, *(0 for _ in FRAMES[LEVEL_CLIPS:])]
    if "tilt_5_infdeg" in condition:
        return [*(0 for _ in level), *FRAMES[LEVEL_CLIPS:]]
    return FRAMES


def write_attitude(run, gain=0.0, seed=0):
    """``<run>/attitude/``; ``gain`` more of the voxels are right where the UAV is tilted. Under the
    true attitude they are those of the run."""
    folder = run / "attitude"
    (folder / "tallies").mkdir(parents=True)
    for name in (condition.name for condition in CONDITIONS):
        if name == "true":
            counted = Counts.read(run / f"tallies/{run.parent.name}.npz")
        else:
            right = RIGHT.get(name, 0.2) + gain * (name == "tilt_5_infdeg")
            counted = _counted(name, right, seed)
        frames = sum(counted.frames)
        protocol = dataclasses.replace(counted.protocol, part=f"test, {name}", frames=frames)
        counted = dataclasses.replace(counted, name=name, protocol=protocol)
        counted.write(folder / "tallies" / f"{name}.npz")

    table = condition_table(CONDITIONS, noise_seed=0)
    scored = [table.assign(score=score, value=0.5) for score in ("miou", "kar_miou")]
    pd.concat(scored).sort_values("condition").to_csv(folder / "attitude.csv", index=False)
    return folder


@cache
def _counted(name, right, seed):
    """Counts do not change, so tests share them."""
    return counts(
        name, lambda target, n: predicted(target, right, 10 * seed + n), frames_of=frames_of(name)
    )
