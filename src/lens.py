"""A camera's lens, and the image that a camera without distortion would have taken in its place."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from .errors import UserError
from .geometry import Array, pixel_centers, tensor_of, unproject

# Samples along a side of a pixel, at most: enough for a width of 7168 in the demo's 224 pixels.
MOST_SAMPLES = 32


@dataclass(frozen=True)
class Lens:
    """A camera with the distortion of Brown and Conrady, in OpenCV's order.

    Args:
        focal_pix: focal lengths along u and v, in pixels.
        center_pix: the principal point (u, v) from the corner of the first pixel: what OpenCV,
            Kalibr and ROS write, plus 0.5.
        distortion: k1, k2, p1, p2, k3; what is left out is zero.

    Raises `UserError` for numbers that no lens has.
    """

    focal_pix: tuple[float, float]
    center_pix: tuple[float, float]
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        numbers = (*self.focal_pix, *self.center_pix, *self.distortion)
        if not all(map(math.isfinite, numbers)) or min(self.focal_pix) <= 0:
            raise UserError(f"camera: {numbers}; give finite numbers, and focal lengths above 0")
        if len(self.distortion) > 5:
            raise UserError(
                f"distortion: {len(self.distortion)} numbers; give k1, k2, p1, p2, k3 (fisheye and "
                "rational models: undistort with OpenCV first)"
            )

    def pix_of(self, rays: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n 2"]:
        """Returns the pixel of each ray (x/z, y/z in the camera frame); NaN where the lens sees
        none: far outside, the polynomial turns round and would show the image once more."""
        k1, k2, p1, p2, k3 = (*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        x, y = rays.unbind(-1)
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))

        bent = torch.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ],
            dim=-1,
        )

        # Where the derivative of the distorted radius, a polynomial of the squared one, is zero.
        turns = np.roots([7 * k3, 5 * k2, 3 * k1, 1])
        turns = turns[(abs(turns.imag) < 1e-9) & (turns.real > 0)].real
        bent[square >= min(turns, default=math.inf)] = torch.nan
        return bent * bent.new_tensor(self.focal_pix) + bent.new_tensor(self.center_pix)


def undistorted(
    image: UInt8[Array, "3 h w"],
    lens: Lens,
    pix_from_camera: Float[Array, "3 3"],
    size_pix: tuple[int, int],
) -> tuple[UInt8[Tensor, "3 height width"], Bool[Tensor, "height width"]]:
    """Returns the image as a pinhole camera at the same place would have taken it, and which of
    its pixels the real camera saw; the others are black.

    ``size_pix`` is width and height of the new image, and ``pix_from_camera`` its camera. Where
    the new image is coarser, each pixel is the mean over its area: nothing aliases.
    """
    camera = tuple(map(tuple, tensor_of(pix_from_camera).double().tolist()))
    places, is_inside, samples = _places(lens, camera, tuple(image.shape[:0:-1]), tuple(size_pix))

    pixels = tensor_of(image).float()[None]
    found = grid_sample(pixels, places[None], padding_mode="border", align_corners=False)

    share = avg_pool2d(is_inside[None].float(), samples)[0]
    seen = share >= 0.5
    mean = avg_pool2d(found[0] * is_inside, samples) / share.clamp(min=0.5)
    return (mean * seen).round().to(torch.uint8), seen


@lru_cache(maxsize=2)
def _places(
    lens: Lens, camera: tuple, image_pix: tuple[int, int], size_pix: tuple[int, int]
) -> tuple[Float[Tensor, "y x 2"], Bool[Tensor, "y x"], int]:
    """Returns the place of every sample in the image (-1 to 1), whether it lies in it, and how
    many samples there are along a side of a pixel."""
    image_size = torch.tensor(image_pix, dtype=torch.float64)

    def placed(samples: int) -> tuple[Float[Tensor, "y x 2"], Bool[Tensor, "y x"]]:
        pix = pixel_centers(*(samples * side for side in size_pix)) / samples
        depth = torch.ones(pix.shape[:-1], dtype=torch.float64)
        of_lens = lens.pix_of(unproject(pix, depth, torch.tensor(camera).double())[..., :2])
        return of_lens, ((of_lens >= 0) & (of_lens < image_size)).all(dim=-1)

    pix, is_inside = placed(1)
    pix[~is_inside] = torch.nan
    apart = max(pix.diff(dim=axis).norm(dim=-1).nan_to_num().max() for axis in (0, 1))
    samples = min(MOST_SAMPLES, max(1, math.ceil(float(apart) - 1e-6)))
    pix, is_inside = placed(samples)
    return (2 * pix / image_size - 1).nan_to_num(2.0).float(), is_inside, samples
