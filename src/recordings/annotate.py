"""Clips of a recording: cut, labelled by the annotation chain of our own data, and written."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..data.clip import CLIP_SECONDS, ClipMeta, ClipWriter
from ..errors import UserError
from ..sim.observation import Annotator, actor_table
from ..terminal import tracked
from ..worker_pool import mapped
from .clip import GROUND_WITHIN_M, RecordedClip, ground_of
from .flight import RecordedFlight, require_rate


@dataclass(frozen=True)
class Cut:
    """How flights become clips: frames a second (null: as recorded), the height of the ground in
    the recording's world (null: found in it), and whether everything stands still."""

    rate_hz: float | None = None
    ground_m: float | None = None
    static: bool = False

    def clips(self, flight: RecordedFlight) -> list[RecordedClip]:
        """Returns the whole clips of a flight, one after the other; what is left over is dropped.

        Raises `UserError` for a flight that is shorter than a clip or of no even rate, for a rate
        that does not divide its own, and where no ground is found.
        """
        recorded_hz = require_rate(flight.folder, flight.time_s)
        stride, rate_hz = _stride(recorded_hz, self.rate_hz)
        of_clip = round(CLIP_SECONDS * rate_hz) * stride
        if len(flight.time_s) < of_clip:
            raise UserError(
                f"{flight.folder}: lasts {len(flight.time_s) / recorded_hz:.1f} s, and a clip has "
                f"{CLIP_SECONDS:g} s; record longer"
            )

        ground_m = ground_of(flight) if self.ground_m is None else self.ground_m
        if ground_m is None:
            raise UserError(
                f"task.ground_m: no frame of {flight.folder} shows ground within "
                f"{GROUND_WITHIN_M:g} m of it; is its depth in metres (in a png: millimetres)? If "
                "it is, give the height of the ground in the recording's world"
            )
        starts = range(0, len(flight.time_s) - of_clip + 1, of_clip)
        settings = stride, rate_hz, ground_m, self.static
        return [RecordedClip(flight, start, *settings) for start in starts]


def _stride(recorded_hz: float, wanted_hz: float | None) -> tuple[int, float]:
    """Returns every how many frames are kept, and their rate."""
    rate_hz = recorded_hz if wanted_hz is None else wanted_hz
    ratio = recorded_hz / rate_hz if rate_hz > 0 else 0.0
    stride = round(ratio)
    of_clip = CLIP_SECONDS * rate_hz

    even = stride > 0 and math.isclose(ratio, stride, rel_tol=0.01)
    if not even or not math.isclose(of_clip, round(of_clip), rel_tol=0.001):
        raise UserError(
            f"task.rate_hz: {rate_hz:g} of a recording of {recorded_hz:g} Hz; give that, or that "
            f"divided by a whole number, with whole frames in {CLIP_SECONDS:g} s, as "
            f"{round(of_clip) / CLIP_SECONDS:.6g}"
        )
    return stride, round(of_clip) / CLIP_SECONDS


def clips_by_name(
    flights: Sequence[RecordedFlight], folder: Path, cut: Cut
) -> dict[str, RecordedClip]:
    """Returns the clips of all flights by their id, ``<flight>/clip<nn>``.

    Raises `UserError` as `Cut.clips` does, and for flights of different rates or image sizes.
    """
    found: dict[str, RecordedClip] = {}
    for flight in tracked(flights, "reading flights"):
        parts = flight.folder.relative_to(folder).parts or (flight.folder.name,)
        name = re.sub(r"[^\w-]", "_", "-".join(parts))
        for number, clip in enumerate(cut.clips(flight)):
            other = found.setdefault(f"{name}/clip{number:02d}", clip)
            if other is not clip:
                raise UserError(
                    f"{flight.folder}: its clips would have the name {name}, as those of "
                    f"{other.flight.folder}; rename one"
                )

    first = next(iter(found.values()))
    for clip in found.values():
        for what, ours, theirs in (
            ("frames a second", first.capture_hz, clip.capture_hz),
            ("pixels", first.camera.size_pix, clip.camera.size_pix),
        ):
            if ours != theirs:
                raise UserError(
                    f"{clip.flight.folder}: {what}: {theirs}, and {first.flight.folder} has "
                    f"{ours}; annotate them apart"
                )
    return found


def write_clips(
    root: Path, clips: dict[str, RecordedClip], annotator: Annotator, workers: int
) -> None:
    """Writes clips to their folders under ``root``, in several processes."""
    make = partial(_write_clip, root, annotator)
    done = mapped(make, min(workers, len(clips)), clips, clips.values())
    for _ in tracked(done, f"annotating {root.name}", len(clips)):
        pass


def _write_clip(root: Path, annotator: Annotator, clip_id: str, clip: RecordedClip) -> None:
    width, height = clip.camera.size_pix
    meta = ClipMeta(
        town=clip_id.split("/")[0],
        weather="recorded",
        seed=0,
        capture_hz=clip.capture_hz,
        width=width,
        height=height,
        pix_from_camera=clip.camera.pix_from_camera,
        body_from_camera=clip.camera.body_from_camera,
        grid=annotator.grid,
    )

    with ClipWriter(root / clip_id, meta) as writer:
        seen = annotator.observe(clip)
        for frame, view in enumerate(seen.views):
            labels = annotator.label(seen, frame)
            writer.add_image(frame, clip.image(frame))
            writer.add_labels(frame, labels.semantics, labels.visible)
            images = {"class": view.class_id, "instance": view.actor_id}
            writer.add_aux(frame, depth=view.depth_m.astype("float32"), **images)
        writer.add_tables(clip.frames, actor_table(seen))
