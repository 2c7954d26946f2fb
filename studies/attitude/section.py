"""The section of a report on attitude: scores by tilt and under wrong poses, and why."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from src.report.section import Reported, Section, ShownFrame
from studies.attitude.conditions import read_conditions
from studies.attitude.figure import draw_report_attitude
from studies.attitude.tables import AttitudeScores, attitude_tables
from studies.attitude.tilt_figure import draw_tilt, level_camera

TILT_CAPTION = (
    "{title}: its camera's frustum in the occ frame, and the image under the labels as that camera "
    "sees them; above with the measured attitude, below as for a level UAV."
)


def attitude_section(reported: Reported) -> Section:
    """Returns the tables, the figure of the curves and the figure of the most tilted frame.

    Raises `UserError` as `read_conditions` does.
    """
    scores = scores_of(reported)
    pictures = {
        "tilt.jpg": _draw_tilt,
        "attitude.png": lambda path, _: draw_report_attitude(scores, path),
    }
    resampled = list(scores.resamples.values())
    return Section(attitude_tables(scores), scores.scores, resampled, pictures=pictures)


@lru_cache(maxsize=1)
def scores_of(reported: Reported) -> AttitudeScores:
    """Returns the counts of `task=attitude`, resampled once for all sections of a report."""
    return AttitudeScores.of(read_conditions(reported.runs), reported.ladder)


def _draw_tilt(path: Path, frames: Sequence[ShownFrame]) -> str:
    if not frames:
        return ""
    clip, _, scene = frames[0]
    draw_tilt(scene, level_camera(scene.frustum, clip), path)
    return TILT_CAPTION.format(title=scene.title)
