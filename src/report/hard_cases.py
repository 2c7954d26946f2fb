"""The test frames that a comparison shows: the hardest, by rules that see no prediction."""

from typing import NamedTuple

import pandas as pd

from .canvas import readable

# What makes a frame hard, and the column that says how hard: |roll| + |pitch|, or how many voxels
# of a class the camera sees.
IN_VIEW = ("thin_structure", "vru", "car", "large_vehicle", "vegetation")
RULES = {"most tilted": "tilt_rad", **{f"most {readable(name)} in view": name for name in IN_VIEW}}


class HardCase(NamedTuple):
    """A frame, and the rule that chose it."""

    reason: str
    clip: str
    frame: int


def hard_cases(frames: pd.DataFrame, count: int) -> list[HardCase]:
    """The hardest frame by each of the first ``count`` of `RULES`, each from another clip.

    ``frames`` has a row for each frame, with its ``clip``, its number ``frame`` and the columns of
    the rules. Of equally hard frames it is the first. A rule that no frame of the clips left
    fulfils, as where nothing of the class is in sight, chooses none.
    """
    chosen: list[HardCase] = []
    for reason, column in list(RULES.items())[:count]:
        if (frames[column] > 0).any():
            hardest = frames.loc[frames[column].idxmax()]
            chosen.append(HardCase(reason, str(hardest["clip"]), int(hardest["frame"])))
            # Another clip each time: two frames of one flight show nearly the same street.
            frames = frames[frames["clip"] != hardest["clip"]]

    return chosen
