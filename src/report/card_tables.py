"""The tables of a dataset's card, in Markdown, ours beside the paper's."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from ..data.clip import CLIP_SECONDS
from ..data.statistics import DENOMINATORS, PARTS, Statistics
from . import paper
from .canvas import readable
from .statistics_figure import percent, visible_totals

NONE = "–"
BESIDE = ("", "here", "the paper")


def settings_table(sim: Mapping, statistics: Statistics) -> str:
    """The paper's table of statistics; ``sim`` are the settings in the manifest."""
    clips, heights_m = statistics.clips, statistics.frames["altitude_m"]
    # A dataset may have more clips of one town than of another.
    clips_per_town = clips.groupby("town").size()
    here = {
        "Simulator": f"Bullet, renderer `{sim['renderer']}`",
        "Scenes": str(clips["town"].nunique()),
        "Weather conditions": str(clips["weather"].nunique()),
        "Clips per scene": _span(clips_per_town, "d"),
        "Clip duration": f"{CLIP_SECONDS:g} s",
        "Capture frequency": f"{sim['capture_hz']:g} Hz",
        "Total samples": f"{len(heights_m):,}",
        "Train / Val / Test": " / ".join(f"{n:,}" for n in statistics.part_sizes().values()),
        "Altitude range": f"{_span(heights_m, '.2f')} m",
        "Learning input": "monocular front-view RGB",
        "Annotation signals": "dual LiDAR + simulator semantics",
    }

    return _table(BESIDE, [(item, here[item], text) for item, text in paper.STATISTICS.items()])


def flight_table(statistics: Statistics) -> str:
    """Heights, speeds, attitude, and the ratio of the rare classes."""
    frames = statistics.frames
    heights_m, speeds_mps = frames["altitude_m"], frames["speed_mps"]
    speeds = f"{speeds_mps.mean():.2f} / {speeds_mps.max():.2f} m/s"
    rows = [
        ("mean height", f"{heights_m.mean():.2f} m", f"{paper.MEAN_HEIGHT_M} m"),
        ("frames below 11 m", f"{statistics.share_below():.1%}", f"{paper.SHARE_BELOW_11_M:.1%}"),
        ("greatest height", f"{heights_m.max():.2f} m", f"< {paper.MAX_HEIGHT_M:g} m"),
        ("speed, mean / greatest", speeds, NONE),
    ]
    for name in ("roll", "pitch"):
        angles_deg = np.rad2deg(frames[f"{name}_rad"])
        spread_deg, most_deg = angles_deg.std(ddof=0), angles_deg.abs().max()
        rows.append((f"{name}, deviation / greatest", f"{spread_deg:.1f}° / {most_deg:.1f}°", NONE))

    reported = [paper.CLASS_SHARES[name] for name in ("thin_structure", "car", "vru")]
    ratio = _ratio(statistics.thin_car_vru()), _ratio([r / reported[-1] for r in reported])

    return _table(BESIDE, [*rows, ("voxels, thin : car : VRU", *ratio)])


def actor_table(statistics: Statistics) -> str:
    """Visible actors by type: sums, means of a frame, and sums at the paper's number of frames."""
    totals, means = visible_totals(statistics), statistics.visible_per_frame()
    header = ["visible actors", "here, in all", "here, a frame", "the paper, a frame"]
    header += [f"here, at {paper.FRAMES:,} frames", "the paper"]

    rows = []
    for name, reported in paper.INSTANCES.items():
        row = [name, f"{totals[name]:,}", f"{means[name]:.2f}", f"{reported / paper.FRAMES:.2f}"]
        rows.append([*row, f"{paper.FRAMES * means[name]:,.0f}", f"{reported:,}"])
    return _table(header, rows)


def class_table(statistics: Statistics) -> str:
    """Shares of the voxels by class, for each of the denominators."""
    rows = []
    for name, shares in statistics.class_shares().iterrows():
        share = paper.CLASS_SHARES.get(name)
        reported = NONE if share is None else f"{100 * share:.4g}%"
        rows.append((readable(name), *map(percent, shares), reported))
    voxels = [statistics.frames[f"voxels/{of}"].mean() for of in DENOMINATORS]
    rows.append(("voxels in a frame", *(f"{count:,.0f}" for count in voxels), NONE))
    return _table(("class", *(f"of {of}" for of in DENOMINATORS), "the paper"), rows)


def split_table(statistics: Statistics) -> str:
    """Frames of each part, and the clips that belong to it as a whole."""
    sizes, total = statistics.part_sizes(), len(statistics.frames)
    rows = []
    for part in PARTS:
        held_out = statistics.clips.query("role == @part")["clip"]
        clips = ", ".join(f"`{clip}`" for clip in held_out) or NONE
        rows.append((part, f"{sizes[part]:,}", f"{sizes[part] / total:.1%}", clips))
    return _table(("part", "frames", "share", "clips held out"), rows)


def benchmark_table(statistics: Statistics) -> str:
    """The paper's Table 1 with a row for this dataset."""
    weathers, sizes = statistics.clips["weather"].nunique(), statistics.part_sizes()
    here = paper.Benchmark("**this dataset**", True, True, True, True, weathers, **sizes)
    header = ["", "UAV view", "3-D annotation", "occupancy", "dynamic camera", "diversity", *PARTS]
    rows = []
    for name, *properties, diversity, train, val, test in (*paper.BENCHMARKS, here):
        marks = ["✓" if has else NONE for has in properties]
        rows.append((name, *marks, str(diversity), *(f"{n:,}" for n in (train, val, test))))
    return _table(header, rows)


def clip_rows(clips: pd.DataFrame) -> str:
    """A row a clip of `Statistics.clip_table`, the columns that one reads first."""
    shares = {"thin": "thin_structure", "car": "car", "VRU": "vru"}
    actors = clips.filter(like="visible_").sum(axis=1) / clips["frames"]
    columns = {
        "clip": clips["clip"].map("`{}`".format),
        "weather": clips["weather"].map(readable),
        "role": clips["role"],
        "frames": clips["frames"].map(str),
        "height (m)": clips["mean_altitude_m"].map("{:.1f}".format),
        "speed (m/s)": clips["mean_speed_mps"].map("{:.1f}".format),
        "visible actors a frame": actors.map("{:.1f}".format),
        **{head: clips[f"share_{name}"].map(percent) for head, name in shares.items()},
        "MB": (clips["bytes"] / 1e6).map("{:.1f}".format),
    }
    return _table(list(columns), list(zip(*columns.values())))


def _span(values: pd.Series, form: str) -> str:
    """The least and the greatest value, once where they read the same."""
    ends = dict.fromkeys(f"{end:{form}}" for end in (values.min(), values.max()))
    return " to ".join(ends)


def _ratio(values: Sequence[float]) -> str:
    return NONE if np.isnan(values).any() else " : ".join(f"{value:.3g}" for value in values)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---", *["--:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
