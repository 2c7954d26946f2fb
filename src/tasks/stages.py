"""The stages of a command and about how long each takes, said before the first one begins."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from omegaconf import DictConfig, OmegaConf

from ..data.clip import CLIP_SECONDS
from ..data.manifest import MANIFEST, missing_clips, read_manifest
from ..data.rates import frames_per_clip
from ..terminal import duration, say
from ..worker_pool import default_workers
from .dataset import root_of, split_of

# Seconds of a core that generating takes, as measured in studies/world.
GENERATION = {"pixel": 1.0e-6, "voxel": 6.5e-8, "frame": 0.003, "clip": 7.6, "town": 6.0}
# Seconds of a core that a frame takes in training, and seconds that one takes to be scored, for the
# model and the priors, of the scales that were measured.
TRAINING = {"tiny": 0.03, "small": 0.3, "ladder": 0.4}
SCORING = {"tiny": 0.1, "small": 0.3, "ladder": 0.3}
DRAWING_S = 10.0
# A busy or an older machine takes so many times as long.
SLOWER = 2.5


class Stage(NamedTuple):
    """A part of a command's work, and the seconds that it takes here; ``None`` where that
    was not measured."""

    what: str
    seconds: float | None

    def __str__(self) -> str:
        if self.seconds is None:
            return f"{self.what}: the bar will tell how long it takes"
        if self.seconds == 0:
            return f"{self.what}: done before"
        # A single number would be believed.
        return f"{self.what}: {duration(self.seconds)} to {duration(SLOWER * self.seconds)}"


def announce(heading: str, stages: Sequence[Stage]) -> None:
    """Prints a heading and a line for each stage."""
    say(f"{heading}, on {cores(default_workers())}:")
    for number, stage in enumerate(stages, start=1):
        say(f"  {number}. {stage}")


def cores(number: int) -> str:
    return "1 core" if number == 1 else f"{number} cores"


def generation(cfg: DictConfig) -> Stage:
    """Returns the stage that makes the missing flights of the configured dataset."""
    root, clips = root_of(cfg), _clip_ids(cfg)
    flights = len(clips)
    what = f"generate {flights} flight{'s' * (flights > 1)} of {CLIP_SECONDS:g} s"
    if (root / MANIFEST).is_file() and not missing_clips(root, clips):
        return Stage(what, 0.0)
    return Stage(what, generation_s(OmegaConf.to_container(cfg.sim, resolve=True), flights))


def stages_of_training(cfg: DictConfig, epochs_done: int) -> list[Stage]:
    """Returns the stages of a run that has finished some epochs before."""
    from .trainer import kind_of_device  # only here: Lightning takes seconds to import

    split, epochs = split_of(cfg, _clip_ids(cfg)), cfg.trainer.max_epochs - epochs_done
    share = cfg.trainer.get("limit_train_batches") or 1.0
    frames = len(split["train"])
    # A whole number counts batches.
    frames = share * (frames if isinstance(share, float) else cfg.data.batch_size)

    is_measured = kind_of_device(cfg.trainer.accelerator) == "cpu" and cfg.scale_name in TRAINING
    training_s = scoring_s = None
    if is_measured:
        threads = min(cfg.threads or default_workers(), default_workers())
        training_s = epochs * frames * TRAINING[cfg.scale_name] / threads
        scoring_s = len(split["test"]) * SCORING[cfg.scale_name]
    return [
        generation(cfg),
        Stage(f"train {epochs} epoch{'s' * (epochs != 1)} of {frames:,.0f} frames", training_s),
        Stage(f"score {len(split['test'])} frames, and the priors", scoring_s),
        Stage("draw predictions beside the labels", DRAWING_S),
    ]


def _clip_ids(cfg: DictConfig) -> list[str]:
    """Returns the clips of the configured dataset, finished or not."""
    root = root_of(cfg)
    if (root / MANIFEST).is_file():
        return list(read_manifest(root)["clips"])
    # Only here, because training on a finished dataset must not need the simulator.
    from ..sim.plan import plan_clips

    return [plan.clip_id for plan in plan_clips(OmegaConf.to_container(cfg.sim, resolve=True))]


def generation_s(sim: Mapping, clips: int) -> float:
    """Returns the seconds that this machine needs for so many clips."""
    # Every worker builds every town.
    workers = min(clips, sim["workers"] or default_workers())
    counts = work_of(sim, clips) | {"town": min(clips, len(sim["towns"]) * workers)}
    return sum(counts[unit] * cost for unit, cost in GENERATION.items()) / workers


def work_of(sim: Mapping, clips: int) -> dict[str, int]:
    """Returns the numbers of clips, frames, pixels and voxels to make."""
    frames = frames_per_clip(sim["capture_hz"]) * clips
    return {
        "clip": clips,
        "frame": frames,
        "pixel": frames * sim["image"]["width"] * sim["image"]["height"],
        "voxel": frames * math.prod(sim["grid"]["shape"]),
    }
