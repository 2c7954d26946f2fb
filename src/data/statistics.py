"""The numbers of a dataset, read from its files: a row a frame, and what the paper reports.

The paper gives shares of voxels without saying of which voxels, so that every share here comes with
three denominators: the labelled voxels, those whose center lies in the front image, and all of the
grid (App. B of the paper, "SkyShield Dataset and Generation Details").
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int64

from ..errors import UserError
from ..geometry import MIN_DEPTH_M, camera_from_occ
from ..jit import njit
from ..ontology import ACTOR_TYPES, CLASSES, UNKNOWN
from ..terminal import tracked
from .clip import Clip
from .manifest import missing_clips, read_manifest
from .split import part_of_time

# An actor with this share of the image's pixels or more counts as visible.
MIN_VISIBLE_SHARE = 5e-5

# The paper gives the share of frames below this height.
LOW_FLIGHT_M = 11.0

DENOMINATORS = ("labelled", "in image", "all")
PARTS = ("train", "val", "test")


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
    towns = manifest["sim"]["towns"]
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
        return _frames_of(clip, role), _summary_of(clip, role)

    # Threads suffice: inflating and counting, which take the time, let go of the interpreter.
    with ThreadPoolExecutor() as pool:
        tables = tracked(pool.map(read, clip_ids), f"reading {root.name}", len(clip_ids))
        frames, clips = zip(*tables)
    return Statistics(pd.concat(frames, ignore_index=True), pd.DataFrame(clips))


def _summary_of(clip: Clip, role: str) -> dict:
    return {
        "clip": clip.clip_id,
        "town": clip.meta.town,
        "weather": clip.meta.weather,
        "role": role,
        "capture_hz": clip.meta.capture_hz,
        "bytes": sum(file.stat().st_size for file in clip.folder.iterdir()),
    }


def _frames_of(clip: Clip, role: str) -> pd.DataFrame:
    """Returns a row a frame, as in `Statistics.frames`."""
    rows, meta = clip.frames, clip.meta
    parts = [part_of_time(n / meta.capture_hz) if role == "split" else role for n in rows["frame"]]
    names = {"clip": clip.clip_id, "town": meta.town, "weather": meta.weather, "part": parts}

    motion = rows[["altitude_m", "roll_rad", "pitch_rad"]]
    speed_mps = np.linalg.norm(rows[["vx_mps", "vy_mps", "vz_mps"]].to_numpy(), axis=1)
    table = pd.DataFrame({**names, **motion, "speed_mps": speed_mps})
    return pd.concat([table, _voxel_counts(clip), visible_actors(clip)], axis=1)


def _voxel_counts(clip: Clip) -> pd.DataFrame:
    """Counts the voxels of each class and of each denominator, a row a frame."""
    labels = (clip.semantics(n).reshape(-1) for n in range(len(clip)))
    counts = np.stack([np.bincount(ids, minlength=UNKNOWN + 1) for ids in labels])
    table = pd.DataFrame(counts[:, : len(CLASSES)], columns=[f"voxels/{name}" for name in CLASSES])
    every = counts.sum(axis=1)
    table["voxels/labelled"] = every - counts[:, UNKNOWN]
    table["voxels/in image"] = voxels_in_image(clip)
    table["voxels/all"] = every
    return table


def visible_actors(clip: Clip) -> pd.DataFrame:
    """Counts the visible actors of each type (``visible/<type>``), a row a frame."""
    # A share of the image, so that the count means the same at every resolution.
    pixels = clip.meta.width * clip.meta.height
    visible = clip.actors[clip.actors["visible_pixels"] >= MIN_VISIBLE_SHARE * pixels]
    counts = pd.crosstab(visible["frame"], visible["type"])
    counts = counts.reindex(index=clip.frames["frame"], columns=list(ACTOR_TYPES), fill_value=0)
    return counts.add_prefix("visible/").reset_index(drop=True)


def liveliest(clips: Sequence[Clip]) -> Clip:
    """Returns the clip with most visible actors in a frame, of equal ones the first."""
    return max(clips, key=lambda clip: visible_actors(clip).to_numpy().sum() / len(clip))


def voxels_in_image(clip: Clip) -> Int64[np.ndarray, "t"]:
    """Counts the voxels of each frame whose center projects into the front image."""
    meta = clip.meta
    # Intrinsics and chain as one 3x4 matrix: a voxel then costs a few products.
    chain = camera_from_occ(clip.world_from_body, meta.body_from_camera)
    pix_from_occ = (meta.pix_from_camera @ chain[:, :3]).numpy()

    space = np.array(meta.grid.lower_m), meta.grid.voxel_m, meta.grid.shape
    counts = [_count_in_image(each, *space, meta.width, meta.height) for each in pix_from_occ]
    return np.array(counts, dtype=np.int64)


@njit(nogil=True)
def _count_in_image(
    pix_from_occ: Float[np.ndarray, "3 4"],
    lower_m: Float[np.ndarray, "3"],
    voxel_m: float,
    shape: tuple[int, int, int],
    width: int,
    height: int,
) -> int:
    """Counts voxels in the image as `project` and `in_image`, without an array of points."""
    count = 0
    for i in range(shape[0]):
        x = lower_m[0] + (i + 0.5) * voxel_m
        for j in range(shape[1]):
            y = lower_m[1] + (j + 0.5) * voxel_m
            column = pix_from_occ[:, 0] * x + pix_from_occ[:, 1] * y + pix_from_occ[:, 3]
            for k in range(shape[2]):
                z = lower_m[2] + (k + 0.5) * voxel_m
                depth = column[2] + pix_from_occ[2, 2] * z
                u, v = column[0] + pix_from_occ[0, 2] * z, column[1] + pix_from_occ[1, 2] * z
                inside = 0 <= u < width * depth and 0 <= v < height * depth
                count += depth > MIN_DEPTH_M and inside
    return count
