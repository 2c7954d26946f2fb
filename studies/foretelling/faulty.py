"""A perception whose camera or attitude is at fault: frames as a broken sensor would give them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image, ImageFilter

from src.errors import UserError
from src.geometry import rotation_from_quat
from src.limits import require_at_least, require_choice
from src.loop.belief import Belief
from src.loop.perception import Perception
from src.loop.true_occupancy import TrueOccupancy
from src.models.frame import StreamFrame
from src.sim.solid import Rng
from src.sim.staging import generator_for

Rgb = UInt8[np.ndarray, "h w 3"]
# What a fault keeps from frame to frame of a flight, by name.
Kept = dict[str, np.ndarray]
DIRT_RGB, DIRT_SHARE_OF_WIDTH = 70, 0.06


@dataclass
class Faulty(Perception):
    """Another ``perception``, whose frames have one ``fault`` of an ``amount``.

    - ``dark``: exposed by so many EV too little;
    - ``noise``: Gaussian noise of so many grey levels, of each frame its own;
    - ``defocus``: blurred by a Gaussian of so many milliradians;
    - ``dirt``: that share of the image is covered, in the same places for all of a flight;
    - ``lost``: that share of the frames does not come: the last image stands for them;
    - ``attitude``: the measured attitude is off by so many degrees, about one horizontal axis that
      is drawn for a flight.

    ``seed`` draws, for every flight anew. Raises `UserError` for another fault, and an
    amount out of range.
    """

    perception: Callable[..., Perception]
    fault: str
    amount: float
    seed: int
    _inner: Perception = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_choice("perception.fault", self.fault, tuple(FAULTS))
        require_at_least(0, "perception", vars(self), "amount", "seed")
        if self.fault in ("dirt", "lost") and self.amount >= 1:
            raise UserError(f"perception.amount: {self.amount} of {self.fault}; give a share")
        self._inner = self.perception(grid=self.grid)

    @property
    def wants_image(self) -> bool:
        return self._inner.wants_image

    def begin(self, truth: TrueOccupancy, flight: str) -> None:
        self._inner.begin(truth, flight)
        self._rng = generator_for(self.seed, "fault", flight)
        self._kept: Kept = {}

    def __call__(self, frame: StreamFrame) -> Belief:
        return self._inner(FAULTS[self.fault](frame, self.amount, self._rng, self._kept))


def dark(frame: StreamFrame, amount_ev: float, *_: object) -> StreamFrame:
    return _seen(frame, _rgb(frame) * 2.0**-amount_ev)


def noise(frame: StreamFrame, amount: float, rng: Rng, _: Kept) -> StreamFrame:
    rgb = _rgb(frame)
    return _seen(frame, rgb + rng.normal(0.0, amount, rgb.shape))


def defocus(frame: StreamFrame, amount_mrad: float, *_: object) -> StreamFrame:
    focal_pix = float(frame.pix_from_camera[0, 0])
    blur = ImageFilter.GaussianBlur(amount_mrad / 1000 * focal_pix)
    return _seen(frame, np.asarray(Image.fromarray(_rgb(frame)).filter(blur)))


def dirt(frame: StreamFrame, share: float, rng: Rng, kept: Kept) -> StreamFrame:
    rgb = _rgb(frame)
    if "dirt" not in kept:
        kept["dirt"] = _discs(rgb.shape[:2], share, rng)
    return _seen(frame, np.where(kept["dirt"][..., None], DIRT_RGB, rgb))


def _discs(size: tuple[int, int], share: float, rng: Rng) -> Bool[np.ndarray, "h w"]:
    """Returns discs at random that cover the share of an image."""
    height, width = size
    covered, (v, u) = np.zeros(size, dtype=bool), np.indices(size)
    while covered.mean() < share:
        radius = DIRT_SHARE_OF_WIDTH * width * rng.uniform(0.5, 1.0)
        covered |= np.hypot(u - rng.uniform(0, width), v - rng.uniform(0, height)) < radius
    return covered


def lost(frame: StreamFrame, share: float, rng: Rng, kept: Kept) -> StreamFrame:
    # The first frame always comes.
    if rng.random() >= share or "image" not in kept:
        kept["image"] = np.asarray(frame.image)
    return frame._replace(image=kept["image"])


def attitude(frame: StreamFrame, amount_deg: float, rng: Rng, kept: Kept) -> StreamFrame:
    if "axis" not in kept:
        angle = rng.uniform(0, 2 * math.pi)
        kept["axis"] = np.array([math.cos(angle), math.sin(angle), 0.0])
    half = math.radians(amount_deg) / 2
    off = rotation_from_quat(np.array([*kept["axis"] * math.sin(half), math.cos(half)]))
    matrix = np.array(frame.world_from_body, dtype=float)
    matrix[:3, :3] = matrix[:3, :3] @ off
    return frame._replace(world_from_body=matrix)


FAULTS = {fault.__name__: fault for fault in (dark, noise, defocus, dirt, lost, attitude)}


def _rgb(frame: StreamFrame) -> Rgb:
    return np.ascontiguousarray(np.asarray(frame.image).transpose(1, 2, 0))


def _seen(frame: StreamFrame, rgb: np.ndarray) -> StreamFrame:
    image = np.clip(np.round(rgb), 0, 255).astype(np.uint8).transpose(2, 0, 1)
    return frame._replace(image=np.ascontiguousarray(image))
