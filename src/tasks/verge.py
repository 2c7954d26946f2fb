"""task=verge: flights past obstacles as a dataset to score on, beside the clips of corridors."""

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from ..data.manifest import DatasetSpec, missing_clips, write_manifest
from ..data.rates import frames_per_clip
from ..data.split import make_split
from ..limits import require_count
from ..locks import locked, telling
from ..loop.campaign import Campaign
from ..provenance import digest_of
from ..terminal import say, tracked
from ..used_code import code_of, targets_of
from ..worker_pool import default_workers
from .fleet import Fleet
from .fly import jobs_of

LOCK = ".lock"
FILMER = "src.loop.clip_of_flight"
# Settings of ``sim`` that shape what is seen of a flight.
SEEN = ("seed", "capture_hz", "image", "camera", "grid", "renderer", "range_m", "camera_stride")
SEEN += ("lidar_hz", "lidar_rays", "save_aux", "weather", "traffic")


def verge(cfg: DictConfig, **_: object) -> None:
    """Writes a dataset of the missions of ``mission``, flown by a UAV that knows the truth.

    Every clip is held out for the test. Clips that are there are not made again. Raises `UserError`
    as `Campaign` and `FlightFilmer` do.
    """
    config = OmegaConf.to_container(cfg, resolve=True)
    require_count("task.workers", config["task"]["workers"])
    Campaign(config)  # for its refusals
    with Fleet([config], config["task"]["workers"] or default_workers()) as fleet:
        jobs = {_clip_id(job.mission): job for job in jobs_of(config, fleet).values()}
        spec, rate = _spec_of(config), config["sim"]["capture_hz"]

        split = make_split(list(jobs), frames_per_clip(rate), rate, [], list(jobs))
        root = spec.root(Path(config["paths"]["data"]))
        root.mkdir(parents=True, exist_ok=True)
        with locked(root / LOCK, telling(f"{root}: another process is making it")):
            missing = missing_clips(root, list(jobs))
            wanted = {clip: jobs[clip] for clip in missing}
            for _ in tracked(fleet.filmed(root, wanted), f"filming {root.name}", len(wanted)):
                pass
            write_manifest(root, spec, list(jobs), split)

    say(f"{root}: {len(missing)} clips made now, {len(jobs)} in all")
    say(f"next: python run.py task=test ckpt_path=FILE paths.dataset={root}")


def _clip_id(mission: object) -> str:
    return f"{mission.map}/clip{mission.index:02d}"


def _spec_of(config: Mapping) -> DatasetSpec:
    """Describes the dataset by what shapes it: the missions, how they are flown, and the code."""
    task, parts = config["task"], {key: config[key] for key in ("mission", "planner", "airframe")}
    given = task["missions"] and sha256(Path(task["missions"]).read_bytes()).hexdigest()
    source = {**parts, "missions": given, "grid": task["grid"], "rules": task["rules"]}
    towns = [f"src.sim.towns.{town}" for town in config["mission"]["towns"]]
    code = digest_of(code_of([FILMER, *towns, *targets_of(parts)]))
    sim = {key: config["sim"][key] for key in SEEN}
    return DatasetSpec(f"{config['scale_name']}-verge", sim, code, source)
