"""Missions and flights of one configuration, in worker processes."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, as_completed
from contextlib import ExitStack
from pathlib import Path

from ..loop.campaign import Campaign, Job
from ..loop.outcome import Row
from ..report.flight_film import Film
from ..results.frame_scores import FrameScores
from ..worker_pool import worker_pool

# Where the scores of frames lie in a folder of flights.
FRAMES = "frames"


class Fleet:
    """Worker processes for the missions and flights of a configuration, inside a ``with``.

    Each keeps to maps of its own: building a town takes seconds.
    """

    def __init__(self, config: Mapping, workers: int) -> None:
        self._config, self._count = config, workers
        self._homes: dict[str, int] = {}

    def __enter__(self) -> "Fleet":
        with ExitStack() as stack:
            pools = (worker_pool(1, _start, (self._config,)) for _ in range(self._count))
            self._pools = [stack.enter_context(pool) for pool in pools]
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> bool | None:
        return self._stack.__exit__(*error)

    def chosen(self, places: Iterable[tuple[str, int]]) -> Iterator[list[Row]]:
        """Yields the missions of each map as they are found."""
        yield from self._done((f"{town}-{seed}", _choose, (town, seed)) for town, seed in places)

    def flown(self, jobs: Iterable[Job], folder: Path) -> Iterator[Row]:
        """Yields the rows of flights as they end; the scores of their frames, where they are
        wanted, are in the folder by then."""
        yield from self._done((job.mission.map, _fly, (job, folder)) for job in jobs)

    def drawn(self, films: Mapping[Path, Job]) -> Iterator[None]:
        """Flies some missions once more before a camera; yields as their films are written."""
        yield from self._done((str(path), _film, (path, job)) for path, job in films.items())

    def _done(self, jobs: Iterable[tuple[str, Callable, tuple]]) -> Iterator:
        """Yields the results of calls as they come; those of one name are made in one process."""
        futures: list[Future] = []
        for name, function, arguments in jobs:
            home = self._homes.setdefault(name, len(self._homes) % self._count)
            futures.append(self._pools[home].submit(function, *arguments))
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

    # Who does not fly looks on: it has a belief of its own.
    looks_on = _campaign.perception if _config["task"]["looks_on"] else None

    row, scores = _campaign.watched(job, lambda stage: FrameScores(stage, _config, looks_on))
    path = folder / FRAMES / f"{job.mission.flight}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    scores.counts(str(row["flight"])).write(path)
    return row


def _film(path: Path, job: Job) -> None:
    threshold = _campaign.planner.threshold
    row, film = _campaign.watched(
        job, lambda stage: Film(stage, _campaign.grid, threshold), draws=True
    )
    film.write(path, row)
