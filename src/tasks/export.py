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

from ..atomic import replacing_folder
from ..errors import UserError
from ..geometry import front_mount, pinhole, rigid, rotation_from_euler
from ..limits import require_at_least
from ..models.export import FORMATS, ExportedStep, export_step, require_formats
from ..models.frame import StreamFrame
from ..models.stream import SkyOccStream
from ..provenance import git_commit, machine
from ..terminal import say
from .session import Session

Logits = Float[Tensor, "9 x y z"]


def export(cfg: DictConfig, formats: Sequence[str], frames: int, tolerance: float) -> None:
    """Writes ``<run>/export/`` and prints how far each graph is from the model, and how fast.

    With ``calibrated`` it is ``<run>/export-calibrated/``.

    Needs no dataset: both compute the frames of `made_up_flight`. The folder is replaced as a
    whole, once every graph has passed. Raises `UserError` as `Session.checkpoint` does, for an
    unknown format, for no frames, and where a graph's logits differ from the model's by more than
    ``tolerance``.
    """
    require_formats(formats)
    require_at_least(1, "task", {"frames": frames}, "frames")
    session = Session(cfg)
    checkpoint = session.checkpoint("export")
    network, config = checkpoint.network(cfg.calibrated), checkpoint.origin.config
    name = "export-calibrated" if cfg.calibrated else "export"
    folder, step_s = session.folder.path / name, config["data"]["history_step_s"]

    flight = made_up_flight(config["sim"], frames, step_s)
    stream = SkyOccStream(network, step_s)
    expected, seconds = run_stream(stream, flight)
    table = Table(title=f"{frames} frames of a stream; {machine()}")
    for column in ("", "largest difference", "labels alike", "ms a frame", "MB"):
        table.add_column(column, justify="right" if column else "left", overflow="fold")
    table.add_row("the model itself", *_cells(0.0, 1.0, seconds))

    # A moment later the history of the stream is still there, and so the example is a full one.
    batch, history = stream.arguments(flight[-1]._replace(time_s=flight[-1].time_s + 1e-3))
    # A graph that fails leaves the folder of an earlier export as it was.
    with replacing_folder(folder) as unchecked:
        export_step(network, batch, history, unchecked, formats, _facts(session, config))
        for name in formats:
            stream = SkyOccStream(ExportedStep(unchecked, name), step_s)
            logits, seconds = run_stream(stream, flight)
            path = unchecked / FORMATS[name]
            worst, alike = _difference(path, logits, expected, tolerance)
            megabytes = f"{path.stat().st_size / 1e6:.1f}"
            table.add_row(path.name, *_cells(worst, alike, seconds), megabytes)

    Console(width=120).print(table)
    say(folder)


def _facts(session: Session, config: Mapping) -> dict[str, object]:
    """Returns the facts of the model in the description beside the graphs."""
    return {
        "name": config["name"],
        "calibrated": session.cfg.calibrated,
        "frames": config["data"]["frames"],
        "history_step_s": config["data"]["history_step_s"],
        "grid": config["grid"],
        "code_version": session.folder.version,
        "git_commit": git_commit(),
    }


def _difference(
    path: Path, logits: Sequence[Logits], expected: Sequence[Logits], tolerance: float
) -> tuple[float, float]:
    """Returns the largest difference of any logit from the model's, and the share of voxels with
    the model's label. Raises `UserError` for a graph that is too far from the model."""
    worst = max((a - b).abs().max().item() for a, b in zip(logits, expected))
    # Not the other way round: a difference that is not a number is no small one.
    if not worst <= tolerance:
        raise UserError(
            f"{path.name}: its logits differ from the model's by {worst:g}, more than "
            f"task.tolerance={tolerance:g}; it is not kept"
        )
    alike = [(a.argmax(0) == b.argmax(0)).double().mean() for a, b in zip(logits, expected)]
    return worst, torch.stack(alike).mean().item()


def made_up_flight(sim: Mapping, count: int, step_s: float) -> list[StreamFrame]:
    """Makes frames ``step_s`` apart of a tilting flight through noise, with the camera of ``sim``.

    They show whether a graph computes what its network does, which noise does as well as a street.
    """
    image, mount = sim["image"], sim["camera"]
    generator = torch.Generator().manual_seed(0)
    pixels = (count, 3, image["height"], image["width"])
    images = torch.randint(0, 256, pixels, generator=generator, dtype=torch.uint8)

    # Roll, pitch and yaw sway at rates of their own, so that no two frames share an attitude.
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
) -> tuple[list[Logits], list[float]]:
    """Returns the logits and the seconds of every frame."""
    logits, seconds = [], []
    for frame in frames:
        start_s = time.perf_counter()
        logits.append(stream(frame))
        seconds.append(time.perf_counter() - start_s)
    return logits, seconds


def _cells(worst: float, alike: float, seconds: Sequence[float]) -> tuple[str, ...]:
    """Returns the cells of a graph in the printed table, beside its name and its size."""
    return f"{worst:.1e}", f"{100 * alike:.3f} %", f"{1e3 * min(seconds):.1f}"
