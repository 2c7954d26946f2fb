"""Makes a data set: clip by clip in parallel, resumable, the same bytes for any number of workers."""

import multiprocessing
import os
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from ..data.clip import CLIP_SECONDS
from ..data.manifest import missing_clips
from ..errors import UserError
from .clip_maker import ClipMaker, ClipPlan
from .pilot import STEP_HZ
from .towns import TOWNS
from .weather import WEATHERS
from .world import import_bullet


def plan_clips(sim: dict) -> list[ClipPlan]:
    """All clips of a data set. Weathers rotate through a town's clips and shift from town to town,
    so that they spread evenly over the towns (App. A.1)."""
    check_settings(sim)
    plans = []
    for place, town in enumerate(sim["towns"]):
        for index in range(sim["clips_per_town"]):
            weather = sim["weathers"][(index + place) % len(sim["weathers"])]
            plans.append(ClipPlan(f"{town}/clip{index:02d}", town, weather, index))
    return plans


def check_settings(sim: dict) -> None:
    """Refuses settings that cannot be generated, before any work starts."""
    for key, known in (("towns", TOWNS), ("weathers", WEATHERS)):
        unknown = [name for name in sim[key] if name not in known]
        if unknown or not sim[key]:
            raise UserError(f"sim.{key}: {unknown or 'empty'}; there are {', '.join(known)}")
    if len(set(sim["towns"])) < len(sim["towns"]):
        raise UserError("sim.towns: a town is named twice; name each once")
    if sim["clips_per_town"] < 1:
        raise UserError("sim.clips_per_town: must be at least 1")
    for key in ("capture_hz", "lidar_hz"):
        if sim[key] <= 0 or (STEP_HZ / sim[key]) % 1 or (CLIP_SECONDS * sim[key]) % 1:
            raise UserError(
                f"sim.{key}: {sim[key]} does not divide the simulation's {STEP_HZ} Hz; "
                "take 2.5, 5, 10, 12.5, 25 or 50"
            )
    if sim["workers"] is not None and sim["workers"] < 1:
        raise UserError("sim.workers: must be at least 1, or null for one per core")


def frames_per_clip(capture_hz: float) -> int:
    """Frames in one clip."""
    return round(CLIP_SECONDS * capture_hz)


def generate(sim: dict, root: Path) -> int:
    """Makes the clips that are not there yet and returns how many that were.

    Raises `UserError` if a worker process dies (out of memory, most often).
    """
    plans = {plan.clip_id: plan for plan in plan_clips(sim)}
    todo = [plans[clip] for clip in missing_clips(root, list(plans))]
    if not todo:
        return 0
    import_bullet()
    root.mkdir(parents=True, exist_ok=True)
    workers = min(len(todo), sim["workers"] or os.cpu_count() or 1)
    context = multiprocessing.get_context("spawn")
    done = context.Value("q", 0)
    frames = frames_per_clip(sim["capture_hz"]) * len(todo)
    with _progress() as progress, ProcessPoolExecutor(
        workers, context, initializer=_start_worker, initargs=(sim, root, done)
    ) as pool:
        bar = progress.add_task(f"generating {root.name}", total=frames)
        pending = {pool.submit(_make_clip, plan): plan for plan in todo}
        try:
            while pending:
                finished, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                progress.update(bar, completed=done.value)
                for future in finished:
                    _finish(future, pending.pop(future))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            raise
    return len(todo)


def _finish(future: Future, plan: ClipPlan) -> None:
    try:
        future.result()
    except BrokenProcessPool as error:
        raise UserError(
            f"sim.workers: a worker died while {plan.clip_id} was being made (out of memory?); "
            "finished clips are kept: run it again with fewer workers"
        ) from error


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("frames"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )


# --------------------------------------------------------------------------- in the worker process

_maker: ClipMaker
_done: Synchronized


def _start_worker(sim: dict, root: Path, done: Synchronized) -> None:
    import torch

    torch.set_num_threads(1)
    global _maker, _done
    _maker, _done = ClipMaker(sim, root), done


def _make_clip(plan: ClipPlan) -> None:
    def on_frame() -> None:
        with _done.get_lock():
            _done.value += 1

    _maker.make(plan, on_frame)
