"""Makes a dataset: clip by clip in parallel, resumable, the same bytes for any workers."""

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from ..data.clip import unfinished
from ..data.manifest import missing_clips
from ..data.rates import frames_per_clip
from ..data.shards import share_of
from ..errors import UserError
from ..locks import locked, telling
from ..terminal import metered
from ..worker_pool import SPAWN, default_workers, worker_pool
from .clip_maker import ClipMaker, ClipPlan
from .plan import plan_clips
from .renderer import require_renderer

LOCK = ".lock"


def generate(sim: Mapping, root: Path) -> int:
    """Makes the clips of this shard that do not exist yet and returns their number.

    Of several processes that want the same clips, one makes them and the others wait. Raises
    `UserError` if a worker process dies (out of memory, most often).
    """
    shard, shards = sim["shard"], sim["shards"]
    plans = {plan.clip_id: plan for plan in share_of(plan_clips(sim), shard, shards)}
    if not missing_clips(root, list(plans)):
        return 0

    # A machine that cannot draw is refused before anything is written.
    require_renderer(sim["renderer"])
    root.mkdir(parents=True, exist_ok=True)
    with _alone_in(root, shard, shards):
        # While this process waited, another one may have made some of them.
        missing = [plans[clip] for clip in missing_clips(root, list(plans))]
        _remove_leftovers(root, plans.values())
        try:
            _make_all(missing, sim, root)
        finally:
            _remove_leftovers(root, plans.values())
    return len(missing)


@contextmanager
def _alone_in(root: Path, shard: int, shards: int) -> Iterator[None]:
    """Holds the folder for this process, or for this shard beside the others; waits if it must."""
    on_wait = telling(f"{root}: another process is making this dataset")
    with ExitStack() as held:
        held.enter_context(locked(root / LOCK, on_wait, shared=shards > 1))
        if shards > 1:
            held.enter_context(locked(root / f".shard{shard}of{shards}{LOCK}", on_wait))
        yield


def _remove_leftovers(root: Path, plans: Iterable[ClipPlan]) -> None:
    """Removes the clips that a process left unfinished when it was killed."""
    for plan in plans:
        shutil.rmtree(unfinished(root / plan.clip_id), ignore_errors=True)


def _make_all(plans: Sequence[ClipPlan], sim: Mapping, root: Path) -> None:
    """Makes clips in worker processes, and shows how many of all their frames are done."""
    if not plans:
        return
    # Shards are taken to share this machine, as they do under the joblib launcher.
    workers = min(len(plans), sim["workers"] or max(1, default_workers() // sim["shards"]))
    frames_done = SPAWN.Value("q", 0)
    frames = frames_per_clip(sim["capture_hz"]) * len(plans)

    pool_of_makers = worker_pool(workers, _start_maker, (sim, root, frames_done))
    with metered(f"generating {root.name}", frames) as meter, pool_of_makers as pool:
        pending = {pool.submit(_make_clip, plan): plan for plan in plans}
        while pending:
            finished, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            meter.done = frames_done.value
            for future in finished:
                _finish(future, pending.pop(future))


def _finish(future: Future, plan: ClipPlan) -> None:
    """Raises the error of a clip that failed."""
    try:
        future.result()
    except BrokenProcessPool as error:
        raise UserError(
            f"sim.workers: a worker died while {plan.clip_id} was being made (out of memory?); "
            "finished clips are kept: run it again with fewer workers"
        ) from error


# --------------------------------------------------------------------------- in the worker process

_maker: ClipMaker
_frames_done: Synchronized


def _start_maker(sim: Mapping, root: Path, frames_done: Synchronized) -> None:
    global _maker, _frames_done
    _maker, _frames_done = ClipMaker(sim, root), frames_done


def _make_clip(plan: ClipPlan) -> None:
    def on_frame() -> None:
        with _frames_done.get_lock():
            _frames_done.value += 1

    _maker.make(plan, on_frame)
