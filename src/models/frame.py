"""A frame of a stream, as a network or another perception looks at it."""

from typing import NamedTuple

from jaxtyping import Float, UInt8

from ..geometry import Array


class StreamFrame(NamedTuple):
    """One input of a stream: an image, when and where it was taken, and how fast the UAV flew.

    ``image`` is uint8 RGB [3, H, W], ``world_from_body`` best in float64, and the velocity in the
    world frame. ``clip`` names the flight: another one begins without history. NumPy arrays will
    do.
    """

    image: UInt8[Array, "3 h w"]
    time_s: float
    world_from_body: Float[Array, "4 4"]
    velocity_mps: Float[Array, "3"]
    pix_from_camera: Float[Array, "3 3"]
    body_from_camera: Float[Array, "4 4"]
    clip: str = ""
