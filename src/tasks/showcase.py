"""Pictures beside a report's numbers: hard frames, and what rungs of the ladder see there."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from statistics import mode
from typing import NamedTuple

import numpy as np
import pandas as pd
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig

from ..data.datamodule import SkyShieldData
from ..data.dataset import OccupancyDataset
from ..errors import UserError
from ..geometry import VoxelGrid
from ..models.checkpoint import Checkpoint
from ..models.network import SkyOcc
from ..ontology import CLASSES
from ..report.hard_cases import HardCase, hard_cases
from ..report.ladder import PAPER, Ladder
from ..report.qualitative import qualitative_sheet
from ..report.scene import VoxelScene
from ..report.section import ShownFrame
from ..results.runs import ScoredRun
from ..run_folder import BEST, CONFIG
from ..terminal import tracked
from .scenes import labels_of, scene_of, tilt_rad

# A JPEG takes a quarter of the bytes of a PNG, whose palette would lose the rare colors.
COMPARISON = "comparison.jpg"


@dataclass(frozen=True)
class Showcase:
    """``figures`` maps pictures to what they show, ``missing`` says what could not be drawn."""

    frames: tuple[ShownFrame, ...] = ()
    figures: dict[Path, str] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


class _Viewer(NamedTuple):
    """A rung: the name of its row, its network, and the test frames with the history it sees."""

    name: str
    network: SkyOcc
    frames: OccupancyDataset


def showcase(
    cfg: DictConfig, runs: Sequence[ScoredRun], folder: Path, count: int, ladder: Ladder = PAPER
) -> Showcase:
    """Returns up to ``count`` frames, by `hard_cases`, and draws their figures into ``folder``.

    Needs the dataset and the runs' best checkpoints; without them it only says so.
    """
    ends = ends_of(runs, ladder)
    if not count or not ends:
        return Showcase()

    root = Path(cfg.paths.dataset or Path(cfg.paths.data) / ends[0].counts.protocol.dataset)
    try:
        data = [_data_of(run, root) for run in ends]
        networks = [Checkpoint.read(run.path / BEST).network() for run in ends]
        names = [ladder.row_name(run.experiment) for run in ends]
        frames = [of_run.dataset("test") for of_run in data]
        viewers = [_Viewer(*each) for each in zip(names, networks, frames)]
        return _drawn(data[0], viewers, folder, count, ends[0].seed)
    except UserError as error:
        return Showcase(missing=(f"no pictures and no scenes: {error}",))


def _data_of(run: ScoredRun, root: Path) -> SkyShieldData:
    """Opens the data that a run was trained on. Raises `UserError` for settings of other code."""
    try:
        settings = {**instantiate(run.config["data"], _convert_="all"), "workers": 0}
        signature(SkyShieldData).bind(root, seed=0, **settings)
    except (TypeError, InstantiationException) as error:
        raise UserError(f"{run.path / CONFIG}: data are those of other code ({error})") from None
    return SkyShieldData(root, seed=0, **settings)


def ends_of(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> list[ScoredRun]:
    """Returns the lowest and the highest rung, of the lowest seed that most of the rungs have."""
    rungs = [run for run in runs if run.experiment in ladder]
    seeds = sorted(run.seed for run in rungs)
    if not seeds:
        return []
    of_seed = {run.experiment: run for run in rungs if run.seed == mode(seeds)}
    present = [of_seed[name] for name in ladder.names if name in of_seed]
    return [*present[:1], *present[1:][-1:]]


def _drawn(
    data: SkyShieldData, viewers: Sequence[_Viewer], folder: Path, count: int, seed: int
) -> Showcase:
    """Predicts the hardest frames with every network, and draws their figure."""
    cases = hard_cases(facts_of(data), count)
    scenes = [_scene(case, viewers, data.grid) for case in tracked(cases, "predicting")]
    heading = f"{data.root.name}, seed {seed}: the hardest test frames by rule"
    qualitative_sheet(scenes, folder / COMPARISON, heading, tops=False)

    names = " and ".join(viewer.name for viewer in viewers)
    caption = (
        f"RGB, ground truth and predictions of {names}, seed {seed}. Test frames by rule: "
        f"{'; '.join(case.reason for case in cases)}; each of another flight, chosen by the labels "
        "and the attitude alone."
    )
    frames = [
        ShownFrame(data.clips[case.clip], case.frame, scene) for case, scene in zip(cases, scenes)
    ]
    return Showcase(tuple(frames), {folder / COMPARISON: caption})


def _scene(case: HardCase, viewers: Sequence[_Viewer], grid: VoxelGrid) -> VoxelScene:
    """Returns a hard case as a scene with the prediction of every viewer."""
    predictions, samples = {}, []
    for name, network, frames in viewers:
        samples.append(frames[frames.samples.index((case.clip, case.frame))])
        predictions[name] = labels_of(network, samples[-1])
    return scene_of(samples[0], grid, predictions, case.reason)


def facts_of(data: SkyShieldData) -> pd.DataFrame:
    """Returns the tilt of every test frame, and how many voxels of each class the camera sees."""
    rows = []
    for clip_id, frame in tracked(data.split["test"], "choosing frames"):
        clip = data.clips[clip_id]
        seen = np.bincount(clip.semantics(frame)[clip.visible(frame)], minlength=len(CLASSES))
        facts = {"clip": clip_id, "frame": frame, "tilt_rad": tilt_rad(clip, frame)}
        rows.append(facts | dict(zip(CLASSES, seen.tolist())))
    return pd.DataFrame(rows)
