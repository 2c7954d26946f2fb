"""task=export: a checkpoint as graphs that run without this code, checked against the model."""

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table
from torch import Tensor

from ..atomic_folder import replacing_folder
from ..errors import UserError
from ..geometry import front_mount, pinhole, rigid, rotation_from_euler
from ..models.export import FORMATS, ExportedStep, export_step, require_formats
from ..models.stream import SkyOccStream, StreamFrame
from ..provenance import git_commit, machine
from ..terminal import say
from .session import Session


def export(cfg: DictConfig, formats: Sequence[str], frames: int, tolerance: float) -> None:
    """Writes ``<run>/export/`` and prints how far each graph is from the model, and how fast.

    Needs no data set: both compute the frames of `made_up_flight`. The folder is replaced as a
    whole, once every graph has passed. Raises `UserError` as `trained` does, for an unknown format,
    for no frames, and where a graph's logits differ from the model's by more than ``tolerance``.
    """
    require_formats(formats)
    if frames < 1:
        raise UserError(f"task.frames: {frames}; give 1 or more")
    session = Session(cfg)
    run, checkpoint = session.folder, session.checkpoint("export")
    network, config = checkpoint.network(), checkpoint.origin.config
    folder, step_s = run.path / "export", config["data"]["history_step_s"]
    facts = {
        "name": config["name"],
        "frames": config["data"]["frames"],
        "history_step_s": step_s,
        "grid": config["grid"],
        "code_version": run.version,
        "git_commit": git_commit(),
    }

    shown = made_up_flight(config["sim"], frames, step_s)
    stream = SkyOccStream(network, step_s)
    expected, seconds = run_stream(stream, shown)
    batch, history = stream.arguments(shown[-1]._replace(time_s=shown[-1].time_s + 1e-3))
    rows = [("the model itself", 0.0, 1.0, seconds, 0)]
    with replacing_folder(folder) as unchecked:
        export_step(network, batch, history, unchecked, formats, facts)
        for name in formats:
            stream = SkyOccStream(ExportedStep(unchecked, name), step_s)
            rows.append(_checked(stream, shown, expected, unchecked / FORMATS[name], tolerance))
    _print(rows, len(shown))
    say(folder)


def _checked(
    stream: SkyOccStream,
    frames: Sequence[StreamFrame],
    expected: Sequence[Float[Tensor, "9 x y z"]],
    path: Path,
    tolerance: float,
) -> tuple[str, float, float, list[float], int]:
    """A row of the table; refuses a graph that is too far from the model."""
    logits, seconds = run_stream(stream, frames)
    worst = max((a - b).abs().max().item() for a, b in zip(logits, expected))
    if not worst <= tolerance:
        raise UserError(
            f"{path.name}: its logits differ from the model's by {worst:g}, more than "
            f"task.tolerance={tolerance:g}; it is not kept"
        )
    alike = [(a.argmax(0) == b.argmax(0)).double().mean() for a, b in zip(logits, expected)]
    return path.name, worst, torch.stack(alike).mean().item(), seconds, path.stat().st_size


def made_up_flight(sim: Mapping, count: int, step_s: float) -> list[StreamFrame]:
    """Frames ``step_s`` apart of a tilting flight through noise, with the camera of ``sim``.

    They tell whether a graph computes what its network does, which noise does as well as a street.
    """
    image, mount = sim["image"], sim["camera"]
    generator = torch.Generator().manual_seed(0)
    pixels = (count, 3, image["height"], image["width"])
    images = torch.randint(0, 256, pixels, generator=generator, dtype=torch.uint8)

    time_s = step_s * torch.arange(count, dtype=torch.float64)
    roll_rad, pitch_rad, yaw_rad = (0.2 * torch.sin(rate * time_s) for rate in (1.0, 1.7, 0.6))
    position_m = torch.stack([5 * time_s, torch.zeros(count).double(), 8 + time_s.sin()], dim=-1)
    world_from_body = rigid(rotation_from_euler(roll_rad, pitch_rad, yaw_rad), position_m)
    velocity_mps = torch.tensor([5.0, 0.0, 0.0], dtype=torch.float64)

    hfov_rad, pitch_down_rad = math.radians(image["hfov_deg"]), math.radians(mount["pitch_deg"])
    camera = {
        "pix_from_camera": pinhole(image["width"], image["height"], hfov_rad),
        "body_from_camera": front_mount(mount["position_m"], pitch_down_rad),
    }
    return [
        StreamFrame(images[n], time_s[n].item(), world_from_body[n], velocity_mps, **camera)
        for n in range(count)
    ]


def run_stream(
    stream: SkyOccStream, frames: Sequence[StreamFrame]
) -> tuple[list[Float[Tensor, "9 x y z"]], list[float]]:
    """Logits and seconds of every frame."""
    logits, seconds = [], []
    for frame in frames:
        start_s = time.perf_counter()
        logits.append(stream(frame))
        seconds.append(time.perf_counter() - start_s)
    return logits, seconds


def _print(rows: Sequence[tuple[str, float, float, list[float], int]], frames: int) -> None:
    table = Table(title=f"{frames} frames of a stream; {machine()}")
    for column in ("", "largest difference", "labels alike", "ms a frame", "MB"):
        table.add_column(column, justify="right" if column else "left", overflow="fold")
    for name, worst, same, seconds, size in rows:
        fastest_ms = 1e3 * min(seconds)
        megabytes = f"{size / 1e6:.1f}" if size else ""
        table.add_row(name, f"{worst:.1e}", f"{100 * same:.3f} %", f"{fastest_ms:.1f}", megabytes)
    Console(width=120).print(table)
