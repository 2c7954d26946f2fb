"""Makes a data set: clip by clip in parallel, resumable, the same bytes for any workers."""

import fcntl
import multiprocessing
import os
import shutil
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

import torch
from rich.console import Console
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

AT_LEAST = {"seed": 0, "clips_per_town": 1, "lidar_rays": 1, "camera_stride": 1, "range_m": 1}
RENDERERS = ("tiny",)
LOCK = ".lock"


def plan_clips(sim: Mapping) -> list[ClipPlan]:
    """All clips of a data set. Weathers rotate through a town's clips and shift from town to town,
    so that they spread evenly over the towns (App. A.1)."""
    check_settings(sim)
    plans = []
    for place, town in enumerate(sim["towns"]):
        for index in range(sim["clips_per_town"]):
            weather = sim["weathers"][(index + place) % len(sim["weathers"])]
            plans.append(ClipPlan(f"{town}/clip{index:02d}", town, weather, index))
    return plans


def check_settings(sim: Mapping) -> None:
    """Refuses settings that cannot be generated, before any work starts."""
    for key, known in (("towns", TOWNS), ("weathers", WEATHERS)):
        unknown = [name for name in sim[key] if name not in known]
        if unknown or not sim[key]:
            raise UserError(f"sim.{key}: {unknown or 'empty'}; there are {', '.join(known)}")
    if len(set(sim["towns"])) < len(sim["towns"]):
        raise UserError("sim.towns: a town is named twice; name each once")
    for key, least in AT_LEAST.items():
        if sim[key] < least:
            raise UserError(f"sim.{key}: {sim[key]} is too small; give {least} or more")
    for key in ("capture_hz", "lidar_hz"):
        if sim[key] <= 0 or (STEP_HZ / sim[key]) % 1 or (CLIP_SECONDS * sim[key]) % 1:
            raise UserError(
                f"sim.{key}: {sim[key]} does not divide the simulation's {STEP_HZ} Hz; "
                "take 2.5, 5, 10, 12.5, 25 or 50"
            )
    if sim["workers"] is not None and sim["workers"] < 1:
        raise UserError("sim.workers: must be at least 1, or null for one per core")
    if not 0 < sim["image"]["hfov_deg"] < 180:
        raise UserError("sim.image.hfov_deg: must lie between 0 and 180; 90 is the design's")
    if sim["renderer"] not in RENDERERS:
        raise UserError(f"sim.renderer: {sim['renderer']}; there is {', '.join(RENDERERS)}")
    ClipMaker(sim, Path())


def frames_per_clip(capture_hz: float) -> int:
    """Frames in one clip."""
    return round(CLIP_SECONDS * capture_hz)


def generate(sim: Mapping, root: Path) -> int:
    """Makes the clips that are not there yet and returns how many that were.

    Of several processes that want the same data set, one makes it and the others wait. Raises
    `UserError` if a worker process dies (out of memory, most often).
    """
    plans = {plan.clip_id: plan for plan in plan_clips(sim)}
    if not missing_clips(root, list(plans)):
        return 0
    import_bullet()
    root.mkdir(parents=True, exist_ok=True)
    with _alone_in(root):
        todo = [plans[clip] for clip in missing_clips(root, list(plans))]
        _remove_leftovers(root)
        try:
            _make_all(todo, sim, root)
        finally:
            _remove_leftovers(root)
    return len(todo)


@contextmanager
def _alone_in(root: Path) -> Iterator[None]:
    """Waits for its turn. The system frees the lock of a process that dies."""
    with open(root / LOCK, "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            Console().print(f"{root}: another process is making this data set; waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _remove_leftovers(root: Path) -> None:
    """Clips that a process left unfinished when it was killed."""
    for folder in root.glob("*/.*.part"):
        shutil.rmtree(folder)


def _make_all(todo: Sequence[ClipPlan], sim: Mapping, root: Path) -> None:
    if not todo:
        return
    workers = min(len(todo), sim["workers"] or os.cpu_count() or 1)
    context = multiprocessing.get_context("spawn")
    done = context.Value("q", 0)
    frames = frames_per_clip(sim["capture_hz"]) * len(todo)
    with _progress() as progress, _pool(workers, context, (sim, root, done)) as pool:
        bar = progress.add_task(f"generating {root.name}", total=frames)
        pending = {pool.submit(_make_clip, plan): plan for plan in todo}
        while pending:
            finished, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            progress.update(bar, completed=done.value)
            for future in finished:
                _finish(future, pending.pop(future))


@contextmanager
def _pool(workers: int, context: SpawnContext, setup: tuple) -> Iterator[ProcessPoolExecutor]:
    """Worker processes, none of which outlives a failure or an interrupt."""
    before = multiprocessing.active_children()
    with ProcessPoolExecutor(workers, context, _start_worker, setup) as pool:
        try:
            yield pool
        except BaseException:
            for process in multiprocessing.active_children():
                if process not in before:
                    process.terminate()
            raise


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


def _start_worker(sim: Mapping, root: Path, done: Synchronized) -> None:
    # Ctrl-C reaches every process of the terminal; the parent ends its workers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    global _maker, _done
    _maker, _done = ClipMaker(sim, root), done


def _die_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)


def _make_clip(plan: ClipPlan) -> None:
    def on_frame() -> None:
        with _done.get_lock():
            _done.value += 1

    _maker.make(plan, on_frame)
