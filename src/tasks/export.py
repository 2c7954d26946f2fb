"""task=export: a checkpoint as graphs that run without this code, checked on real frames."""

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table
from torch import Tensor

from ..atomic_folder import replacing_folder
from ..data.clip import Clip
from ..data.datamodule import SkyShieldData
from ..data.dataset import velocity_world_mps
from ..errors import UserError
from ..models.export import FORMATS, ExportedStep, export_step, require_formats
from ..models.stream import SkyOccStream, StreamFrame
from ..provenance import git_commit, machine
from .trained import trained


def export(cfg: DictConfig, formats: Sequence[str], frames: int, tolerance: float) -> None:
    """Writes ``<run>/export/`` and prints how far each graph is from the model, and how fast.

    The folder is replaced as a whole, once every graph has passed. Raises `UserError` as `trained`
    does, for an unknown format, for no frames, and where a graph's logits differ from the model's
    by more than ``tolerance``.
    """
    require_formats(formats)
    if frames < 1:
        raise UserError(f"task.frames: {frames}; give 1 or more")
    run, data, _, module, _ = trained(cfg, "export")
    folder, step_s = run.path / "export", cfg.data.history_step_s
    facts = {
        "name": cfg.name,
        "frames": cfg.data.frames,
        "history_step_s": step_s,
        "grid": OmegaConf.to_container(cfg.grid, resolve=True),
        "code_version": run.version,
        "git_commit": git_commit(),
    }
    shown = list(stream_frames(data, frames))
    stream = SkyOccStream(module.network, step_s)
    expected, seconds = run_stream(stream, shown)
    batch, history = stream.arguments(shown[-1]._replace(time_s=shown[-1].time_s + 1e-3))
    rows = [("the model itself", 0.0, 1.0, seconds, 0)]
    with replacing_folder(folder) as unchecked:
        export_step(module.network, batch, history, unchecked, formats, facts)
        for name in formats:
            stream = SkyOccStream(ExportedStep(unchecked, name), step_s)
            rows.append(_checked(stream, shown, expected, unchecked / FORMATS[name], tolerance))
    _print(rows, len(shown))
    Console().print(f"{folder}", highlight=False, soft_wrap=True)


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


def stream_frames(data: SkyShieldData, count: int) -> Iterator[StreamFrame]:
    """Consecutive frames, a history step apart, of the clip of which most is for testing.

    Raises `UserError` where it has fewer.
    """
    dataset = data.dataset("test")
    tested = Counter(clip_id for clip_id, _ in dataset.samples)
    clip_id = tested.most_common(1)[0][0]
    first = next(frame for clip, frame in dataset.samples if clip == clip_id)
    clip = data.clips[clip_id]
    numbers = range(first, len(clip), dataset.step)[:count]
    if len(numbers) < count:
        raise UserError(f"task.frames: {clip_id} has {len(numbers)} to test; ask for fewer")
    return (_frame(clip, clip_id, number) for number in numbers)


def _frame(clip: Clip, clip_id: str, number: int) -> StreamFrame:
    return StreamFrame(
        image=torch.from_numpy(clip.image(number).copy()).permute(2, 0, 1).contiguous(),
        time_s=number / clip.meta.capture_hz,
        world_from_body=clip.world_from_body[number],
        velocity_mps=velocity_world_mps(clip, number),
        pix_from_camera=clip.meta.pix_from_camera,
        body_from_camera=clip.meta.body_from_camera,
        clip=clip_id,
    )


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
