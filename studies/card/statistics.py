"""The numbers of a dataset, read from its files: a row a frame, and what the paper reports.

The paper gives shares of voxels without saying of which voxels, so that every share here comes with
three denominators: the labelled voxels, those whose center lies in the front image, and all of the
grid (App. A.1 of the paper, "SkyShield Dataset and Generation Details").
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Int64

from src.data.actors import visible_actors
from src.data.clip import Clip
from src.data.manifest import missing_clips, read_manifest
from src.data.split import PARTS, part_of_time
from src.errors import UserError
from src.geometry import MIN_DEPTH_M, camera_from_occ
from src.ontology import ACTOR_TYPES, CLASSES, UNKNOWN
from src.terminal import tracked

# The paper gives the share of frames below this height.
LOW_FLIGHT_M = 11.0

DENOMINATORS = ("labelled", "in image", "all")


@dataclass(frozen=True)
class Statistics:
    """A dataset in two tables; the rest is derived from them.

    ``frames`` has a row a frame: ``clip``, ``town``, ``weather``, ``part`` of the split,
    ``altitude_m``, ``speed_mps``, ``roll_rad``, ``pitch_rad``, the voxels of each class
    (``voxels/<class>``) and of the denominators (``voxels/labelled``, ``voxels/in image``,
    ``voxels/all``), and the visible actors of each type (``visible/<type>``).
    ``clips`` has a row a clip: ``clip``, ``town``, ``weather``, ``role`` (``split`` for one that is
    split by time, ``val`` or ``test`` for one held out), ``capture_hz``, ``bytes``.
    """

    frames: pd.DataFrame
    clips: pd.DataFrame

    def class_shares(self) -> pd.DataFrame:
        """Returns shares of the voxels, a row a class, a column for each of `DENOMINATORS`."""
        total = self.frames.filter(like="voxels/").sum()
        counts = total[[f"voxels/{name}" for name in CLASSES]].to_numpy()
        shares = {of: counts / max(1, total[f"voxels/{of}"]) for of in DENOMINATORS}
        return pd.DataFrame(shares, index=pd.Index(CLASSES, name="class"))

    def thin_car_vru(self) -> tuple[float, float, float]:
        """Returns the voxels of thin structures, cars and VRUs for one of VRUs; NaN without any."""
        thin, car, vru = self.class_shares()["all"][["thin_structure", "car", "vru"]]
        return (thin / vru, car / vru, 1.0) if vru else (np.nan, np.nan, np.nan)

    def visible_per_frame(self) -> pd.Series:
        """Returns the mean number of visible actors in a frame, by type."""
        return self.frames[[f"visible/{name}" for name in ACTOR_TYPES]].mean().set_axis(ACTOR_TYPES)

    def share_below(self, height_m: float = LOW_FLIGHT_M) -> float:
        """Returns the share of the frames that were taken below a height above the ground."""
        return float((self.frames["altitude_m"] < height_m).mean())

    def part_sizes(self) -> dict[str, int]:
        """Counts the frames of training, validation and test."""
        return {part: int((self.frames["part"] == part).sum()) for part in PARTS}

    def by_town_and_weather(self, table: pd.DataFrame) -> pd.DataFrame:
        """Counts rows of ``clips`` or ``frames``, town by weather, in order of appearance."""
        # crosstab sorts its keys, and the clips have the plan's order.
        towns, weathers = (self.clips[key].unique() for key in ("town", "weather"))
        counts = pd.crosstab(table["town"], table["weather"])
        return counts.reindex(index=towns, columns=weathers, fill_value=0)

    def clip_table(self) -> pd.DataFrame:
        """Returns a row a clip: ``clips``, means over its frames, visible actors, class shares.

        ``visible_<type>`` sums the visible actors over the frames, ``share_<class>`` is of the
        clip's labelled voxels.
        """
        of_clip = self.frames.groupby("clip", sort=False)
        means = of_clip[["altitude_m", "speed_mps"]].mean().add_prefix("mean_").round(4)
        visible = of_clip[[f"visible/{name}" for name in ACTOR_TYPES]].sum()
        visible.columns = visible.columns.str.replace("/", "_")

        # A clip without a label has no share of any class.
        voxels = of_clip[[f"voxels/{name}" for name in CLASSES]].sum()
        shares = voxels.div(of_clip["voxels/labelled"].sum().clip(lower=1), axis=0).round(8)
        shares.columns = shares.columns.str.replace("voxels/", "share_")

        clips = self.clips.set_index("clip").assign(frames=of_clip.size())
        table = clips.join([means, visible, shares])
        return table[[*table.columns.drop("bytes"), "bytes"]].reset_index()


def statistics_of(root: Path) -> Statistics:
    """Reads the statistics of a finished dataset.

    Raises `UserError` where the dataset is unfinished or a file cannot be read.
    """
    manifest = read_manifest(root)
    # In the order in which they were planned: the manifest's keys are in alphabetical order.
    # Towns of a recording are its flights.
    towns = manifest["sim"].get("towns") or sorted({c.partition("/")[0] for c in manifest["clips"]})
    clip_ids = sorted(manifest["clips"], key=lambda clip: towns.index(clip.partition("/")[0]))

    if missing := missing_clips(root, clip_ids):
        raise UserError(
            f"{root}: {len(missing)} of {len(clip_ids)} clips are missing, {missing[0]} first; "
            "run task=generate to make them"
        )
    roles = {clip: part for part, clips in manifest["held_out"].items() for clip in clips}
    return statistics_of_clips(root, clip_ids, roles)


def statistics_of_clips(
    root: Path, clip_ids: Sequence[str], roles: Mapping[str, str] | None = None
) -> Statistics:
    """Reads the statistics of some clips, also of a dataset that is still being made.

    ``roles`` gives the part (``val`` or ``test``) of the clips that are held out.
    """
    roles = roles or {}

    def read(clip_id: str) -> tuple[pd.DataFrame, dict]:
        clip, role = Clip(root / clip_id), roles.get(clip_id, "split")
        meta, files = clip.meta, clip.folder.iterdir()
        summary = {
            **{"clip": clip.clip_id, "town": meta.town, "weather": meta.weather, "role": role},
            **{"capture_hz": meta.capture_hz, "bytes": sum(file.stat().st_size for file in files)},
        }
        return _frames_of(clip, role), summary

    # Threads suffice: inflating and counting, which take the time, let go of the interpreter.
    with ThreadPoolExecutor() as pool:
        tables = tracked(pool.map(read, clip_ids), f"reading {root.name}", len(clip_ids))
        frames, clips = zip(*tables)
    return Statistics(pd.concat(frames, ignore_index=True), pd.DataFrame(clips))


def _frames_of(clip: Clip, role: str) -> pd.DataFrame:
    """Returns a row a frame, as in `Statistics.frames`."""
    rows, meta = clip.frames, clip.meta
    parts = [part_of_time(n / meta.capture_hz) if role == "split" else role for n in rows["frame"]]
    names = {"clip": clip.clip_id, "town": meta.town, "weather": meta.weather, "part": parts}
    motion = rows[["altitude_m", "roll_rad", "pitch_rad"]]
    speed_mps = np.linalg.norm(rows[["vx_mps", "vy_mps", "vz_mps"]].to_numpy(), axis=1)

    labels = (clip.semantics(n).reshape(-1) for n in range(len(clip)))
    counts = np.stack([np.bincount(ids, minlength=UNKNOWN + 1) for ids in labels])
    every = counts.sum(axis=1)
    voxels = {
        **dict(zip(CLASSES, counts.T)),
        "labelled": every - counts[:, UNKNOWN],
        "in image": voxels_in_image(clip),
        "all": every,
    }
    table = pd.DataFrame({**names, **motion, "speed_mps": speed_mps})
    voxels = pd.DataFrame(voxels).add_prefix("voxels/")
    return pd.concat([table, voxels, visible_actors(clip)], axis=1)


def voxels_in_image(clip: Clip) -> Int64[np.ndarray, "t"]:
    """Counts the voxels of each frame whose center projects into the front image."""
    meta = clip.meta
    chain = camera_from_occ(clip.world_from_body, meta.body_from_camera)
    pix_from_occ = (meta.pix_from_camera @ chain[:, :3]).numpy()
    x, y, z = (
        lower + (np.arange(size) + 0.5) * meta.grid.voxel_m
        for lower, size in zip(meta.grid.lower_m, meta.grid.shape)
    )

    counts = np.zeros(len(clip), dtype=np.int64)
    for frame, rows in enumerate(pix_from_occ):
        # As `project` and `in_image`, from one term an axis instead of a point a voxel.
        u, v, depth = (
            (a * x[:, None, None] + b * y[:, None] + offset) + c * z for a, b, c, offset in rows
        )
        inside = (u >= 0) & (u < meta.width * depth) & (v >= 0) & (v < meta.height * depth)
        counts[frame] = np.count_nonzero(inside & (depth > MIN_DEPTH_M))
    return counts
