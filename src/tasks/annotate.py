"""task=annotate: makes clips of this benchmark of a simulator's recording."""

import os
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from ..data.manifest import DatasetSpec, missing_clips, write_manifest
from ..data.rates import frames_per_clip
from ..data.split import make_split
from ..errors import UserError
from ..geometry import VoxelGrid
from ..locks import locked, telling
from ..provenance import digest_of
from ..recordings.annotate import Cut, clips_by_name, write_clips
from ..recordings.clip import RecordedClip
from ..sim.observation import Annotator
from ..terminal import say
from ..used_code import code_of
from ..worker_pool import default_workers

LOCK = ".lock"
# Files that somebody corrects: their sizes may stay.
TABLES = (".csv", ".json", ".txt")
# Settings of ``sim`` that shape the labels of a recording, too.
SHAPING = ("range_m", "camera_stride", "lidar_hz")


def annotate(
    cfg: DictConfig,
    rate_hz: float | None,
    ground_m: float | None,
    val_clips: Sequence[str],
    test_clips: Sequence[str],
) -> None:
    """Writes a dataset of the folder ``recording``, in its ``layout``, under ``paths.data``.

    Its grid is the configured one. Clips that are there are not made again. Raises `UserError` for
    a layout of predictions, and as the layout, `Cut.clips` and `make_split` do.
    """
    folder = Path(str(cfg.recording)).absolute()
    if cfg.recording is None:
        raise UserError("recording: name the folder to annotate, as recording=DIR")
    if "_target_" not in cfg.layout:
        raise UserError(
            f"layout: {cfg.layout.name} is one of predictions; give layout=airsim, carla, plain or "
            "tartanair"
        )
    settings = {key: each for key, each in cfg.layout.items() if key != "name"}
    layout = instantiate(settings, _convert_="all")
    cut = Cut(rate_hz, ground_m, getattr(layout, "static", False))
    clips = clips_by_name(layout.flights(folder), folder, cut)
    if unmatched := getattr(layout, "unmatched", ()):
        say(f"classes that are general here: {', '.join(sorted(unmatched))}")

    spec = _spec_of(cfg, folder, next(iter(clips.values())), cut)
    rate = spec.sim["capture_hz"]
    split = make_split(list(clips), frames_per_clip(rate), rate, list(val_clips), list(test_clips))
    root = spec.root(Path(cfg.paths.data))
    root.mkdir(parents=True, exist_ok=True)
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    annotator = Annotator(
        VoxelGrid(**sim["grid"]), sim["range_m"], sim["camera_stride"], sim["lidar_hz"]
    )
    with locked(root / LOCK, telling(f"{root}: another process is annotating it")):
        missing = {clip: clips[clip] for clip in missing_clips(root, list(clips))}
        if missing:
            write_clips(root, missing, annotator, sim["workers"] or default_workers())
        write_manifest(root, spec, list(clips), split)
    say(f"{root}: {len(missing)} clips made now, {len(clips)} in all")
    say(f"next: python run.py task=check paths.dataset={root}")


def _spec_of(cfg: DictConfig, folder: Path, clip: RecordedClip, cut: Cut) -> DatasetSpec:
    """Describes the dataset by what shapes it: settings, the recording, and the code."""
    width, height = clip.camera.size_pix
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    shaping = {key: sim[key] for key in SHAPING}
    shaping |= {"grid": sim["grid"], "image": {"width": width, "height": height}}

    source = {
        "layout": OmegaConf.to_container(cfg.layout, resolve=True),
        "cut": vars(cut),
        "files": _listing(folder),
    }
    code = digest_of(code_of(["src.recordings.annotate", cfg.layout["_target_"]]))
    made = {**shaping, "capture_hz": clip.capture_hz, "save_aux": True}
    return DatasetSpec(folder.name, made, code, source)


def _listing(folder: Path) -> str:
    """Returns a digest of the names of all files of a recording, of the sizes of its images, and of
    what its tables hold."""
    found = []
    for place, _, names in os.walk(folder, followlinks=True):
        for path in (Path(place, name) for name in names):
            is_table = path.suffix in TABLES
            held = sha256(path.read_bytes()).hexdigest() if is_table else path.stat().st_size
            found.append((str(path.relative_to(folder)), held))
    return digest_of(sorted(found))
