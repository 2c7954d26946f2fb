"""Missions and flights, in worker processes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import cache
from pathlib import Path

from ..errors import UserError
from ..loop.campaign import Campaign, Job
from ..loop.clip_of_flight import FlightFilmer
from ..loop.outcome import Row
from ..report.flight_film import Film
from ..results.frame_scores import FrameScores
from ..run_folder import NO_RECIPE
from ..worker_pool import worker_pool

# Where the scores of frames lie in a folder of flights.
FRAMES = "frames"


class Fleet(ExitStack):
    """Worker processes for the missions and flights of some configurations, inside a ``with``.

    Each keeps to maps of its own: building a town takes seconds. Flights name their configuration
    by its number; missions and films are those of the first one.
    """

    def __init__(self, configs: Sequence[Mapping], workers: int) -> None:
        super().__init__()
        pools = (worker_pool(1, _start, (configs,)) for _ in range(workers))
        self._pools = [self.enter_context(pool) for pool in pools]
        self._homes: dict[str, int] = {}

    def chosen(self, places: Iterable[tuple[str, int]]) -> Iterator[list[Row]]:
        """Yields the missions of each map as they are found."""
        yield from self._done((f"{town}-{seed}", _choose, (town, seed)) for town, seed in places)

    def flown(self, flights: Iterable[tuple[int, Job, Path]]) -> Iterator[tuple[int, Row]]:
        """Yields the numbers and rows of flights as they end; the scores of their frames, where
        they are wanted, are in the folder by then."""
        yield from self._done((each[1].mission.map, _fly, each) for each in flights)

    def drawn(self, films: Mapping[Path, Job]) -> Iterator[None]:
        """Flies some missions once more before a camera; yields as their films are written."""
        yield from self._done((str(path), _film, (path, job)) for path, job in films.items())

    def filmed(self, root: Path, jobs: Mapping[str, Job]) -> Iterator[None]:
        """Writes flights of a UAV that knows the truth as clips of a dataset; yields as they are
        there."""
        yield from self._done(
            (job.mission.map, _clip, (root, clip, job)) for clip, job in jobs.items()
        )

    def _done(self, jobs: Iterable[tuple[str, Callable, tuple]]) -> Iterator:
        """Yields the results of calls as they come; those of one name are made in one process."""
        futures: list[Future] = []
        for name, function, arguments in jobs:
            home = self._homes.setdefault(name, len(self._homes) % len(self._pools))
            futures.append(self._pools[home].submit(function, *arguments))

        for future in as_completed(futures):
            try:
                result = future.result()
            except BrokenProcessPool as error:
                raise UserError(
                    "task.workers: a worker died (out of memory?); finished flights are kept: run "
                    "it again with fewer workers"
                ) from error
            yield result


# --------------------------------------------------------------------------- in the worker process

_configs: Sequence[Mapping]


def _start(configs: Sequence[Mapping]) -> None:
    global _configs
    _configs = configs


@cache
def _campaign(number: int) -> Campaign:
    return Campaign(_configs[number])


def _choose(town: str, seed: int) -> list[Row]:
    return _campaign(0).choose(town, seed)


def _fly(number: int, job: Job, folder: Path) -> tuple[int, Row]:
    config, campaign = _configs[number], _campaign(number)
    # Who looks at no image has not been trained.
    recipe = {"recipe": config["recipe_name"] if campaign.pilot.wants_image else NO_RECIPE}
    if not config["task"]["scored"]:
        return number, campaign.fly(job) | recipe

    # Who does not fly looks on: it has a belief of its own.
    looks_on = campaign.perception if config["task"]["looks_on"] else None

    row, scores = campaign.watched(job, lambda stage: FrameScores(stage, config, looks_on))
    path = folder / FRAMES / f"{job.mission.flight}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    scores.counts(str(row["flight"])).write(path)
    return number, row | recipe


def _clip(root: Path, clip_id: str, job: Job) -> None:
    FlightFilmer(_configs[0], root, {clip_id: job}).film(clip_id)


def _film(path: Path, job: Job) -> None:
    campaign = _campaign(0)
    threshold = campaign.planner.threshold
    row, film = campaign.watched(
        job, lambda stage: Film(stage, campaign.grid, threshold), draws=True
    )
    film.write(path, row)
