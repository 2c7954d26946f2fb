"""The hook of a report: a section adds tables and pictures that the report itself does not know.

The mapping ``sections`` of ``task=report`` names its sections.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from inspect import signature
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ..data.clip import Clip
from ..errors import UserError, closest
from ..results.render import Table
from ..results.runs import ScoredRun
from ..results.table import Resamples
from .ladder import Ladder
from .scene import VoxelScene


class ShownFrame(NamedTuple):
    """A hard frame of a clip, with the predictions that the report shows of it."""

    clip: Clip
    frame: int
    scene: VoxelScene


# Writes a picture to a path and returns its caption; an empty one where there is nothing to draw.
Draw = Callable[[Path, Sequence[ShownFrame]], str]


@dataclass(frozen=True, eq=False)
class Reported:
    """The input of a section.

    ``runs`` are the finished runs whose differences are reported, ``parts`` their resampled scores
    by part of the test split, and ``out`` is the folder of the report.
    """

    ladder: Ladder
    runs: Sequence[ScoredRun]
    parts: Mapping[str, Resamples]
    out: Path


@dataclass(frozen=True)
class Section:
    """The output of a section; ``resampled`` has the resamples behind its intervals.

    ``scores`` are rows of the long table. Every seed of the sweep is expected of ``experiments``,
    as it is of the rungs. ``pictures`` has every picture that the section may draw, by file name.
    """

    tables: Sequence[Table] = ()
    scores: pd.DataFrame = field(default_factory=pd.DataFrame)
    resampled: Sequence[Resamples] = ()
    experiments: Sequence[str] = ()
    pictures: Mapping[str, Draw] = field(default_factory=dict)


def with_settings(
    sections: Mapping[str, Callable[..., Section]], settings: Mapping[str, object]
) -> list[Callable[[Reported], Section]]:
    """Gives each section those of the settings that it has a parameter for.

    Raises `UserError` for a setting that no section reads.
    """
    parameters = [signature(section).parameters.keys() for section in sections.values()]
    known = sorted(set().union(*parameters) - {"reported"})
    for name in settings:
        if name not in known:
            raise UserError(
                f"task.{name}: nothing reads this key{closest(name, known)} the sections of the "
                f"report read {', '.join(known) or 'none'}"
            )

    return [
        partial(section, **{name: settings[name] for name in of_section & settings.keys()})
        for section, of_section in zip(sections.values(), parameters)
    ]
