"""task=fly: a UAV flies missions on what a perception believes; a row a flight."""

from collections import deque
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from ..data.files import BROKEN
from ..data.manifest import NOT_SHAPING, TOWNS
from ..errors import UserError, reason_of, way_out_of
from ..limits import require_count
from ..loop.campaign import CHOOSING, ROUTE, Campaign, Job
from ..loop.mission import ROOM_M, in_the_open
from ..provenance import digest_of
from ..results.files import write_table
from ..results.flights import FLIGHTS
from ..run_folder import CONFIG, VERSION
from ..sim.weather import Weather
from ..terminal import say, tracked
from ..used_code import code_of, targets_of
from ..worker_pool import default_workers
from .fleet import Fleet
from .flights import print_scores

MISSIONS = "missions.csv"
# Of the maps, for the printed intervals.
RESAMPLES = 1000
# What says which missions there are: those that a UAV with perfect knowledge completes.
CAMPAIGN = "src.loop.campaign"
# Of the task: what shapes flights.
SHAPING = ("grid", "rules", "fusion", "missions", "looks_on", "scored")
OF_MISSIONS = ("mission", "planner", "airframe")


def fly(cfg: DictConfig, films: bool, **_: object) -> None:
    """Writes ``flights.csv`` to ``task.out``, beside the configuration, and ``films`` of some
    flights.

    The missions are those of the file ``task.missions``, or they are drawn: once for all
    perceptions, and kept under ``paths.data``. Flights that have a row are not flown again. Raises
    `UserError` where ``task.out`` has flights of another configuration, for a mission that begins
    or ends in something, and as `Campaign` does.
    """
    config = OmegaConf.to_container(cfg, resolve=True)
    folder = Path(config["task"]["out"])
    with _fleet_of([config]) as fleet:
        jobs = jobs_of(config, fleet)
        _keep(folder, config)
        [table] = _flown(fleet, jobs, [folder], config["perception"]["name"])
        if films:
            wanted = {folder / f"{stem}.gif": jobs[each] for stem, each in films_of(table).items()}
            missing = {path: job for path, job in wanted.items() if not path.exists()}
            deque(tracked(fleet.drawn(missing), "drawing", len(missing)), maxlen=0)

    print_scores({table["perception"].iloc[0]: {"": table}}, None, RESAMPLES)
    for ending in (FLIGHTS, "*.gif", "*.html", "*.mcap"):
        for path in sorted(folder.glob(ending)):
            say(path)


def fly_together(configs: Sequence[Mapping]) -> None:
    """Flies the missions of several configurations, each into its own ``task.out``.

    They take turns on every mission: its town, traffic and true voxels take longer than a flight,
    and are made once for all. Raises `UserError` for other missions than the first one's, and as
    `fly` does.
    """
    with _fleet_of(configs) as fleet:
        jobs = jobs_of(configs[0], fleet)
        folders = [Path(config["task"]["out"]) for config in configs]
        for folder, config in zip(folders, configs):
            _keep(folder, config)
        _flown(fleet, jobs, folders, f"{len(configs)} perceptions")


def _fleet_of(configs: Sequence[Mapping]) -> Fleet:
    """Returns the worker processes of the first configuration, for flights of all of them, whose
    folders hold no others."""
    first = configs[0]
    require_count("task.workers", first["task"]["workers"])
    for config in tracked(configs, "opening"):
        Campaign(config)  # for its refusals
        task = config["task"]
        same_file = task["missions"] == first["task"]["missions"]
        if not same_file or _of_missions(config) != _of_missions(first):
            raise UserError(f"{task['out']}: flies other missions than the first one")
        _require_same(Path(task["out"]), config)
    return Fleet(configs, first["task"]["workers"] or default_workers())


def _flown(
    fleet: Fleet, jobs: Mapping[str, Job], folders: Sequence[Path], name: str
) -> list[pd.DataFrame]:
    """Returns the rows of all flights by folder; those that have none yet are flown."""
    paths = [folder / FLIGHTS for folder in folders]
    tables = [
        pd.read_csv(path, keep_default_na=False) if path.is_file() else pd.DataFrame()
        for path in paths
    ]
    known = [set(table["flight"]) if len(table) else set() for table in tables]
    missing = [
        (number, job, folder)
        for flight, job in jobs.items()
        for number, folder in enumerate(folders)
        if flight not in known[number]
    ]

    for number, row in tracked(fleet.flown(missing), f"flying {name}", len(missing)):
        table = pd.concat([tables[number], pd.DataFrame([row])])
        tables[number] = table.sort_values("flight", ignore_index=True)
        write_table(tables[number], paths[number])
    return tables


def jobs_of(config: Mapping, fleet: Fleet) -> dict[str, Job]:
    """Returns the missions of a file, or those of the configuration, by the name of the flight."""
    missions = config["task"]["missions"]
    table = given_missions(Path(missions), config["sim"]) if missions else _missions(config, fleet)
    return {job.mission.flight: job for job in map(Job.of, table.to_dict("records"))}


def films_of(flights: pd.DataFrame) -> dict[str, str]:
    """Returns which flights are drawn, by the names of their files: the first collision, the
    closest call and the clearest arrival, as far as there are such."""
    by_clearance = flights[flights["outcome"] == "arrived"].sort_values(
        "clearance_m", kind="stable"
    )
    arrived = by_clearance["flight"].tolist()
    films = {"collision": flights[flights["outcome"] == "collided"]["flight"].tolist()[:1]}
    films |= {"close_call": arrived[:1], "clean": arrived[1:][-1:]}
    return {name: flight for name, found in films.items() for flight in found}


def _missions(config: Mapping, fleet: Fleet) -> pd.DataFrame:
    """Returns the missions of a configuration, drawn where they are not there."""
    settings = _of_missions(config)
    digest = digest_of({**settings, "code": _code(config, settings)})
    path = Path(config["paths"]["data"]) / f"missions-{digest}" / MISSIONS

    table = _read(path) if path.is_file() else pd.DataFrame(columns=["town", "seed"])
    places = instantiate(config["mission"]).places()
    known = set(zip(table["town"], table["seed"]))
    missing = [place for place in places if place not in known]
    for rows in tracked(fleet.chosen(missing), "choosing missions", len(missing)):
        parts = [pd.DataFrame(rows)] if table.empty else [table, pd.DataFrame(rows)]
        table = pd.concat(parts).sort_values("flight", ignore_index=True)
        write_table(table, path)
    return table


def _of_missions(config: Mapping) -> dict[str, object]:
    """Returns the settings that say which missions there are."""
    keys = {key: dict(config[key]) for key in OF_MISSIONS}
    # They are chosen with one of each.
    for key in CHOOSING:
        keys["planner"].pop(key, None)
    keys |= {key: config["task"][key] for key in ("grid", "rules")}
    return keys | {"traffic": config["sim"]["traffic"]}


def _read(path: Path) -> pd.DataFrame:
    # Older pandas reads floats only nearly, and a flight would differ in its last bits.
    return pd.read_csv(path, float_precision="round_trip")


def given_missions(path: Path, sim: Mapping) -> pd.DataFrame:
    """Returns missions that somebody wrote or picked; nobody has looked yet where they lead."""
    if not path.is_file():
        raise UserError(f"task.missions: no file {path}; give one like {MISSIONS}")
    try:
        table = _read(path)
    except BROKEN as error:
        way_out = way_out_of(error, f"give one like {MISSIONS}", path)
        raise UserError(
            f"task.missions: {path} is no table ({reason_of(error)}); {way_out}"
        ) from error

    if missing := sorted({"stratum", "truth_s", *ROUTE} - set(table)):
        raise UserError(f"task.missions: {path} has no column {', '.join(missing)}")
    _require_sound(path, table)
    for weather in table["weather"].unique():
        Weather.of(sim, weather)  # for its refusals
    for row in table.to_dict("records"):
        mission = Job.of(row).mission
        if not in_the_open(mission, mission.place):
            raise UserError(
                f"task.missions: {path}: {mission.flight} begins or ends in a wall, under a roof "
                f"or within {ROOM_M} m of something; move it"
            )
    return table


def _require_sound(path: Path, table: pd.DataFrame) -> None:
    """Refuses missions that lack a number, and one that is there twice."""
    names = [name for name in (*ROUTE, "truth_s") if name not in ("town", "weather")]
    numbers = table[names].apply(pd.to_numeric, errors="coerce")
    sound = np.isfinite(numbers).all(axis=1) & (numbers["truth_s"] > 0)
    sound &= (numbers[["seed", "index"]] % 1 == 0).all(axis=1)
    sound &= ~table.duplicated(["town", "seed", "index"])
    if not sound.any() or not sound.all():
        row = f"row {int(sound.argmin()) + 1}" if len(table) else "no row"
        raise UserError(
            f"task.missions: {path}: {row}; give numbers for {', '.join(names)} (seed and index "
            "whole, truth_s above 0), and each town, seed and index once"
        )


def _require_same(folder: Path, config: Mapping) -> None:
    """Refuses to add flights of another configuration, of other code or of other weights."""
    path = folder / VERSION
    if path.is_file() and path.read_text() != digest_of(_shaping(config)):
        raise UserError(
            f"{folder}: has flights of another configuration, code or checkpoint; give another "
            "task.out"
        )


def _keep(folder: Path, config: Mapping) -> None:
    """Keeps the configuration beside the flights, and what shapes them."""
    _require_same(folder, config)  # another process may have begun meanwhile
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / VERSION).is_file():
        OmegaConf.save(OmegaConf.create(config), folder / CONFIG)
        (folder / VERSION).write_text(digest_of(_shaping(config)))


def _shaping(config: Mapping) -> dict[str, object]:
    """Returns all that shapes flights."""
    sim = {key: value for key, value in config["sim"].items() if key not in NOT_SHAPING}
    task = {key: config["task"][key] for key in SHAPING}
    parts = {key: config[key] for key in ("perception", *OF_MISSIONS)}
    if config["task"]["scored"]:
        parts |= {key: config[key] for key in ("metric", "suite")}
    weights = config["ckpt_path"]
    if weights and not Path(weights).is_file():
        raise UserError(f"ckpt_path: no file {weights}; give the file of a checkpoint")
    digest = sha256(Path(weights).read_bytes()).hexdigest() if weights else ""
    models = config["model"] if weights else {}
    code = _code(config, [parts, models])
    return {"sim": sim, "task": task, "code": code, "weights": digest, **parts}


def _code(config: Mapping, settings: object) -> dict[str, str]:
    """Returns the digests of the code that settings use, and of the missions and their towns."""
    towns = [f"{TOWNS}.{town}" for town in config["mission"]["towns"]]
    return code_of([CAMPAIGN, *towns, *targets_of(settings)])
