"""Parallax: how well an image agrees with past ones, at every depth of every pixel.

A plane sweep (Collins 1996) without parameters. The cost volume is computed once a frame: beside
the data in training, in the stream in flight.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import repeat

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from .errors import UserError
from .geometry import inverse, world_from_occ
from .jit import njit
from .limits import require_choice, require_count

# The depths of the hypotheses are equally far apart in the logarithm, as the bins that pixels are
# taught (`models.sight`).
NEAR_M, FAR_M = 1.0, 64.0
# A volume, and the labels of pixels, have one place in each square of so many pixels: as coarse as
# the finest features of an image encoder.
RASTER = 4
# Added to the variance of grey (0 to 1) in a window: what has no texture agrees with nothing.
NOISE = 6e-5
# A past image says nothing of a place whose match moves less than this between 10 m and infinity:
# where the camera hovers, and around the direction in which it flies.
LEAST_PIX, AT_M = 0.5, 10.0
# Luminance of red, green and blue (ITU-R BT.601).
LUMA = (0.299, 0.587, 0.114)
PROJECTIONS = ("attitude", "level")


class Parallax:
    """A cost volume: the normalised cross-correlation of windows with past images, by depth.

    ``ages_s`` says how old the past images are. Each is warped to the current one as if everything
    lay in a plane in front of the camera, once for each of ``per_bin`` depths in each of ``bins``
    bins. Windows of ``window`` pixels are compared, and the mean over the past images that see the
    whole window, and see it move, counts; of a bin's depths the best one. Where there is none, the
    volume is zero: in a first frame everywhere, and in one that hovers.

    ``projection`` is the network's: with ``"level"`` roll and pitch are left out of the warp.

    Raises `UserError` for ages that are none, not above 0 or not in order, for a window that is not
    odd, and for another projection.
    """

    def __init__(
        self,
        ages_s: Sequence[float] = (0.2, 0.4, 0.8, 1.6),
        bins: int = 48,
        per_bin: int = 2,
        window: int = 7,
        projection: str = "attitude",
    ) -> None:
        require_choice("model.encoder.projection", projection, PROJECTIONS)
        if (
            not ages_s
            or sorted({*ages_s}) != [*ages_s]
            or not all(0 < age < math.inf for age in ages_s)
        ):
            raise UserError(
                f"data.parallax.ages_s: {[*ages_s]}; give one age above 0 or more, in order"
            )
        if window < 3 or window % 2 == 0:
            raise UserError(f"data.parallax.window: {window}; give an odd number, 3 or more")

        require_count("data.parallax.bins", bins)
        require_count("data.parallax.per_bin", per_bin)

        self.ages_s, self.bins, self.window = (*ages_s,), bins, window
        self.settings = {
            **{"ages_s": [*ages_s], "bins": bins, "per_bin": per_bin},
            **{"window": window, "projection": projection},
        }
        self.projection = projection
        steps = torch.arange(bins * per_bin, dtype=torch.float64) + 0.5
        self.depths_m = NEAR_M * (FAR_M / NEAR_M) ** (steps / len(steps))

    def strides(self, capture_hz: float) -> list[int]:
        """Returns how many frames before the current one the past images are, oldest first.

        Raises `UserError` for an age that falls between frames.
        """
        strides = [age_s * capture_hz for age_s in reversed(self.ages_s)]
        if any(abs(stride - round(stride)) > 1e-6 for stride in strides):
            raise UserError(
                f"data.parallax.ages_s: {[*self.ages_s]} are no multiples of the capture interval "
                f"{1 / capture_hz:g} s; choose others, or model/parallax=off"
            )
        return [round(stride) for stride in strides]

    def volume(
        self,
        images: Sequence[UInt8[Tensor, "3 H W"]],
        world_from_body: Float[Tensor, "n 4 4"],
        body_from_camera: Float[Tensor, "4 4"],
        pix_from_camera: Float[Tensor, "n 3 3"],
    ) -> UInt8[Tensor, "bins h w"]:
        """Computes the volume of the last image with those before it, of which there may be none.

        Transforms are float64. Raises `UserError` for images of different sizes.
        """
        if len({image.shape for image in images}) > 1:
            sizes = ", ".join(f"{image.shape[2]}x{image.shape[1]}" for image in images)
            raise UserError(f"image: {sizes} in one clip; give images of one size")

        *past, now = [_grey(image.numpy()) for image in images]
        if not past:
            return torch.zeros(self.bins, *(n // RASTER for n in now.shape), dtype=torch.uint8)

        past_from_now = self._past_from_now(world_from_body, body_from_camera)
        cameras = pix_from_camera[:-1]
        at_infinity = cameras @ past_from_now[:, :3, :3] @ torch.linalg.inv(pix_from_camera[-1])
        epipole = (cameras @ past_from_now[:, :3, 3:])[..., 0]
        moving = _moving(at_infinity.numpy(), epipole.numpy(), now.shape)
        sweep = partial(_sweep, now, np.stack(past), at_infinity.numpy(), epipole.numpy(), moving)

        # Each depth is a sweep of its own, so PyTorch's threads share them.
        parts = np.array_split(self.depths_m.numpy(), torch.get_num_threads())
        with ThreadPoolExecutor(len(parts)) as pool:
            agreement = pool.map(sweep, parts, repeat(self.window // 2))
        return torch.from_numpy(_by_bin(np.concatenate([*agreement]), self.bins))

    def _past_from_now(
        self, world_from_body: Float[Tensor, "n 4 4"], body_from_camera: Float[Tensor, "4 4"]
    ) -> Float[Tensor, "n-1 4 4"]:
        """Returns the past cameras from the current one, with the attitude of the projection."""
        if self.projection == "level":
            world_from_body = world_from_occ(world_from_body)
        world_from_camera = world_from_body @ body_from_camera
        return inverse(world_from_camera[:-1]) @ world_from_camera[-1]


def _grey(image: UInt8[np.ndarray, "3 h w"]) -> Float[np.ndarray, "h w"]:
    return np.tensordot(np.float32(LUMA) / np.float32(255), image.astype(np.float32), 1)


def _by_bin(agreement: Float[np.ndarray, "depths h w"], bins: int) -> UInt8[np.ndarray, "bins h w"]:
    """Returns the best agreement of each bin, from 0 (none, or opposite) to 255 (the same)."""
    best = agreement.reshape(bins, -1, *agreement.shape[1:]).max(axis=1)
    return np.rint(255 * best.clip(0, 1)).astype(np.uint8)


def _moving(
    at_infinity: Float[np.ndarray, "n 3 3"],
    epipole: Float[np.ndarray, "n 3"],
    size: tuple[int, int],
) -> Bool[np.ndarray, "n h w"]:
    """Marks the places of the volume whose match in a past image moves with their depth."""
    v, u = (np.arange(RASTER // 2, n, RASTER) + 0.5 for n in size)
    pixels = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))])
    far = np.tensordot(at_infinity, pixels, 1)
    near = far + epipole[..., None, None] / AT_M
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = far[:, :2] / far[:, 2:] - near[:, :2] / near[:, 2:]
        return np.hypot(*apart.swapaxes(0, 1)) >= LEAST_PIX


@partial(njit, nogil=True)
def _sweep(image, past, at_infinity, epipole, moving, depths_m, reach):
    """Returns the mean agreement [depths, h / RASTER, w / RASTER] with the past images [n, h, w].

    A plane at depth d is seen in past image k at ``at_infinity[k] + [0, 0, epipole[k] / d]``, which
    is a homography of pixels. Windows reach ``reach`` pixels to each side of their centers; at the
    border of the current image they are cut.
    """
    height, width = image.shape
    shape = (height // RASTER, width // RASTER)
    agreement = np.zeros((len(depths_m), *shape), dtype=np.float32)
    counts = np.zeros(shape, dtype=np.float32)
    warped = np.empty((height, width), dtype=np.float32)
    mean, deviation = _moments(image, reach)
    corners = np.empty((*past.shape, 4), dtype=np.float32)
    for k in range(len(past)):
        _fill_corners(past[k], corners[k])

    for depth in range(len(depths_m)):
        counts[:] = 0
        for k in range(len(past)):
            homography = at_infinity[k].copy()
            homography[:, 2] += epipole[k] / depths_m[depth]
            _warp(corners[k], homography, warped)
            found = agreement[depth]
            _add_agreement(image, mean, deviation, warped, moving[k], reach, found, counts)
        agreement[depth] /= np.maximum(counts, np.float32(1))
    return agreement


@njit
def _fill_corners(image, corners):
    """Fills ``corners`` with what an interpolation reads, side by side: the pixel and how much
    brighter its right neighbour is, then both of the row below."""
    height, width = image.shape
    for row in range(height - 1):
        for column in range(width - 1):
            for below in range(2):
                left, right = image[row + below, column], image[row + below, column + 1]
                corners[row, column, 2 * below] = left
                corners[row, column, 2 * below + 1] = right - left


@njit
def _warp(corners, homography, warped):
    """Fills ``warped`` with the past image at each pixel's place in it, which is NaN outside.

    A place lies between four pixels, and at most on the outermost pixels' centers. Places come
    first and all at once, so that the compiler computes many in one instruction.
    """
    height, width = warped.shape
    x, y = np.empty(width, np.float32), np.empty(width, np.float32)
    first = np.empty(width, np.int32)
    zero, flat = np.float32(0), corners.reshape(-1, 4)

    for row in range(height):
        _places(homography, row, x, y)
        for column in range(width):
            inside = (0 <= x[column] <= width - 1) & (0 <= y[column] <= height - 1)
            right, down = (x[column], y[column]) if inside else (zero, zero)
            left, top = min(np.int32(right), width - 2), min(np.int32(down), height - 2)
            first[column] = top * width + left
            x[column] = right - np.float32(left) if inside else np.float32(np.nan)
            y[column] = down - np.float32(top)

        for column in range(width):
            pixel, more, pixel_below, more_below = flat[first[column]]
            above = pixel + x[column] * more
            below = pixel_below + x[column] * more_below
            warped[row, column] = above + y[column] * (below - above)


@njit
def _places(homography, row, x, y):
    """Fills ``x`` and ``y`` with the places of a row's pixels, NaN behind the camera."""
    half, one = np.float32(0.5), np.float32(1)
    h = homography.astype(np.float32)
    v = np.float32(row) + half
    for column in range(len(x)):
        u = np.float32(column) + half
        depth = h[2, 0] * u + (h[2, 1] * v + h[2, 2])
        scale = one / depth if depth > np.float32(1e-6) else np.float32(np.nan)
        x[column] = (h[0, 0] * u + (h[0, 1] * v + h[0, 2])) * scale - half
        y[column] = (h[1, 0] * u + (h[1, 1] * v + h[1, 2])) * scale - half


@njit
def _add_agreement(image, mean, deviation, warped, moving, reach, agreement, counts):
    """Adds the correlation of every window that moves and is seen whole, and counts these."""
    height, width = image.shape
    sums = np.empty((3, width), dtype=np.float32)
    for i in range(height // RASTER):
        top, bottom = _window(i, reach, height)
        _sum_rows(image, warped, top, bottom, sums)

        for j in range(width // RASTER):
            left, right = _window(j, reach, width)
            pixels = np.float32((bottom - top) * (right - left))
            b, bb, ab = _totals(sums, left, right)
            # A window that is not seen whole has no sum.
            if not moving[i, j] or np.isnan(b):
                continue

            variance = bb / pixels - (b / pixels) ** 2 + NOISE
            covariance = ab / pixels - mean[i, j] * b / pixels
            agreement[i, j] += covariance / (deviation[i, j] * np.sqrt(variance))
            counts[i, j] += 1


@njit
def _sum_rows(image, warped, top, bottom, sums):
    """Sums over some rows, column by column: the warped image, its square, and its product with
    the current one."""
    sums[:] = 0
    for row in range(top, bottom):
        for column in range(image.shape[1]):
            b = warped[row, column]
            sums[0, column] += b
            sums[1, column] += b * b
            sums[2, column] += b * image[row, column]


@njit
def _totals(sums, left, right):
    b = bb = ab = np.float32(0)
    for column in range(left, right):
        b += sums[0, column]
        bb += sums[1, column]
        ab += sums[2, column]
    return b, bb, ab


@njit
def _moments(image, reach):
    """Returns mean and standard deviation of every window of the current image."""
    height, width = image.shape
    shape = (height // RASTER, width // RASTER)
    mean, deviation = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
    for i in range(shape[0]):
        for j in range(shape[1]):
            (top, bottom), (left, right) = _window(i, reach, height), _window(j, reach, width)
            window = image[top:bottom, left:right]
            mean[i, j] = window.mean()
            deviation[i, j] = np.sqrt(window.var() + NOISE)
    return mean, deviation


@njit
def _window(i, reach, size):
    """Returns the first row of a window, or its first column, and the one after the last."""
    center = RASTER * i + RASTER // 2
    return max(center - reach, 0), min(center + reach + 1, size)
