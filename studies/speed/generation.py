"""The time of generation by stage: one clip on one core.

    python -m studies.speed.generation --width 384 --height 224 --capture-hz 25
                                       [--towns TOWN...] [OVERRIDE...]

Prints milliseconds a frame of every stage, for the first clip of every town under the weather that
its place in the dataset gives it; then frames a second of one core, and the peak memory. The first
frames compile the kernels: a short clip before the measured ones pays for that. Towns are built
beforehand, as a worker does once for all clips of a town; what that takes is printed below.
"""

import resource
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import pandas as pd
import torch
from omegaconf import OmegaConf

from src.data.clip import ClipWriter
from src.provenance import machine
from src.sim import clip_maker
from src.sim.clip_maker import ClipMaker, ClipPlan
from src.sim.fusion import ActorMap, StaticMap
from src.sim.plan import plan_clips
from src.sim.staging import place_of
from src.sim.towns import town_names
from src.sim.world import World
from studies.settings import composed, run
from studies.speed.timing import timed

TOWNS = tuple(town_names())
# The functions that are timed: the stage's name in the table, the owner, and the name there.
STAGES: list[tuple[str, object, str]] = [
    ("flight, traffic, scene", ClipMaker, "stage"),
    ("LiDAR rays", clip_maker, "scan"),
    ("meshes into bullet", World, "__enter__"),
    ("rendering", World, "render"),
    ("weather", clip_maker, "apply_weather"),
    ("fusion of points and free space", StaticMap, "add"),
    ("fusion of points and free space", StaticMap, "add_points"),
    ("fusion of points and free space", ActorMap, "add"),
    ("fusion of points and free space", StaticMap, "freeze"),
    ("labels", clip_maker, "label_frame"),
    ("writing images", ClipWriter, "add_image"),
    ("writing labels", ClipWriter, "add_labels"),
    ("writing tables, sums, sync", ClipWriter, "_seal"),
]


@contextmanager
def timed_stages() -> Iterator[dict[str, float]]:
    """Collects the wall-clock seconds of every stage while the context is open."""
    seconds: dict[str, float] = defaultdict(float)
    with ExitStack() as patches:
        for stage, owner, name in STAGES:
            function = timed(seconds, stage)(getattr(owner, name))
            patches.enter_context(patch.object(owner, name, function))
        yield seconds


def main(
    *overrides: str,
    width: int = 384,
    height: int = 224,
    capture_hz: float = 25.0,
    towns: tuple[str, ...] = TOWNS,
) -> None:
    torch.set_num_threads(1)
    image = [f"sim.image.width={width}", f"sim.image.height={height}"]
    of_towns = ["sim.clips_per_town=1", f"sim.towns=[{','.join(towns)}]"]
    words = ["scale=paper", f"sim.capture_hz={capture_hz}", *image, *of_towns, *overrides]
    sim = _sim(words)
    plans = plan_clips(sim)

    # The first frames compile the kernels.
    _make(_sim([*words, "sim.capture_hz=2.5", "data.history_step_s=0.4"]), plans[0])
    print(f"{machine()}, one thread, 1 clip a town, sim.seed=0")
    print(f"{width}x{height}, grid {sim['grid']['shape']}, {capture_hz:g} Hz")
    built_s: dict[str, float] = defaultdict(float)
    columns = {}
    for plan in plans:
        # A worker builds a town once for all its clips, so that is not part of a clip's time.
        with timed(built_s, plan.town):
            place_of(plan.town, sim["seed"])
        columns[f"{plan.town} {plan.weather}"] = _measure(sim, plan)

    table = pd.DataFrame(columns)
    table["mean"] = table.mean(axis=1)
    print(table.to_string(float_format="{:.1f}".format))
    print(f"building a town: {max(built_s.values()):.1f} s at most")
    print(f"labelled frames a second of one core: {1000 / table.loc['in all', 'mean']:.1f}")
    # Linux counts it in KiB.
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


def _sim(overrides: list[str]) -> dict:
    return OmegaConf.to_container(composed(overrides).sim, resolve=True)


def _make(sim: dict, plan: ClipPlan) -> int:
    """Makes a clip and returns its number of frames."""
    frames = []
    with tempfile.TemporaryDirectory() as folder:
        ClipMaker(sim, Path(folder)).make(plan, lambda: frames.append(1))
    return len(frames)


def _measure(sim: dict, plan: ClipPlan) -> pd.Series:
    """Returns the milliseconds a frame by stage, and in all."""
    with timed_stages() as seconds, timed(seconds, "in all"):
        frames = _make(sim, plan)

    rows = {stage: seconds[stage] for stage, _, _ in STAGES}
    # Whatever no stage claims, such as the sorting of actors into tables.
    rows["the rest"] = seconds["in all"] - sum(rows.values())
    rows["in all"] = seconds["in all"]
    return 1000 * pd.Series(rows) / frames


if __name__ == "__main__":
    run(main)
