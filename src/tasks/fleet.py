"""Missions and flights of one configuration, in worker processes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from contextlib import ExitStack
from pathlib import Path

from ..loop.campaign import Campaign, Job
from ..loop.outcome import Row
from ..loop.stage import Stage
from ..results.frame_scores import FrameScores
from ..worker_pool import worker_pool

# Where the scores of frames lie in a folder of flights.
FRAMES = "frames"


def chosen(config: Mapping, maps: Sequence[tuple[str, int]], workers: int) -> Iterator[list[Row]]:
    """Yields the missions of each map as they are found."""
    jobs = [(number, _choose, place) for number, place in enumerate(maps)]
    yield from _done(config, jobs, workers)


def flown(config: Mapping, jobs: Sequence[Job], workers: int, folder: Path) -> Iterator[Row]:
    """Yields the rows of flights as they end; the scores of their frames, where they are wanted,
    are in the folder by then."""
    maps = {job.mission.map: None for job in jobs}
    number = {name: index for index, name in enumerate(maps)}
    yield from _done(
        config, [(number[job.mission.map], _fly, (job, folder)) for job in jobs], workers
    )


def _done(config: Mapping, jobs: Iterable[tuple], workers: int) -> Iterator:
    """Yields results from workers, each of which keeps to maps of its own: building a town takes
    seconds."""
    with ExitStack() as stack:
        pools = [
            stack.enter_context(worker_pool(1, _start, (config,))) for _ in range(max(workers, 1))
        ]
        futures: list[Future] = [
            pools[number % len(pools)].submit(function, *arguments)
            for number, function, arguments in jobs
        ]
        for future in as_completed(futures):
            yield future.result()


# --------------------------------------------------------------------------- in the worker process

_config: Mapping
_campaign: Campaign


def _start(config: Mapping) -> None:
    global _config, _campaign
    _config, _campaign = config, Campaign(config)


def _choose(town: str, seed: int) -> list[Row]:
    return _campaign.choose(town, seed)


def _fly(job: Job, folder: Path) -> Row:
    if not _config["task"]["scored"]:
        return _campaign.fly(job)

    watching: list[FrameScores] = []
    # Who does not fly looks on: it has a belief of its own.
    looks_on = _campaign.perception if _config["task"]["looks_on"] else None

    def watch(stage: Stage) -> FrameScores:
        watching.append(FrameScores(stage, _config, looks_on))
        return watching[0]

    row = _campaign.fly(job, watch)
    path = folder / FRAMES / f"{job.mission.flight}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    watching[0].counts(str(row["flight"])).write(path)
    return row
