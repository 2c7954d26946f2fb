"""The rates at which the simulation is captured."""

from collections.abc import Mapping

from ..errors import UserError
from .clip import CLIP_SECONDS

# Rate of the simulation. Captures subsample it, so that their rate never changes a flight.
STEP_HZ = 50


def require_rates(sim: Mapping) -> None:
    """Raises `UserError` for a rate of ``sim`` that does not divide the simulation's."""
    for key in ("capture_hz", "lidar_hz"):
        if sim[key] <= 0 or (STEP_HZ / sim[key]) % 1 or (CLIP_SECONDS * sim[key]) % 1:
            raise UserError(
                f"sim.{key}: {sim[key]} does not divide the simulation's {STEP_HZ} Hz; "
                "take 2.5, 5, 10, 12.5, 25 or 50"
            )


def frames_per_clip(capture_hz: float) -> int:
    """Returns the number of frames in one clip."""
    return round(CLIP_SECONDS * capture_hz)
