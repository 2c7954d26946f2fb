"""The resampling of a real camera's images: against OpenCV, and against what must not happen."""

import math

import cv2
import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import pinhole, pixel_centers
from src.lens import Lens, undistorted

DISTORTION = (-0.28, 0.07, 0.001, -0.0005, 0.004)  # about that of EuRoC's cameras
SIZE, FOCAL, CENTER = (320, 200), (210.0, 205.0), (163.0, 97.5)
HALF = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


def opencv_camera(focal, center):
    """What OpenCV calls the camera of a lens: it counts from the center of the first pixel."""
    matrix = [[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]]
    return np.array(matrix) - HALF


def smooth_image(width, height):
    """Waves in three colors, without edges."""
    u, v = pixel_centers(width, height).unbind(-1)
    waves = [torch.sin(u / 9 + k) + torch.cos(v / 7 - k) for k in range(3)]
    return (torch.stack(waves) * 60 + 127).round().to(torch.uint8)


@pytest.mark.parametrize("distortion", [(), DISTORTION[:2], DISTORTION])
def test_the_map_is_that_of_opencv(distortion):
    lens, new = Lens(FOCAL, CENTER, distortion), pinhole(224, 128, math.radians(60))
    rays = (pixel_centers(224, 128) - new[:2, 2]) / new[0, 0]
    camera = opencv_camera(FOCAL, CENTER)
    told = np.array([*distortion, *[0.0] * (5 - len(distortion))])
    expected = cv2.initUndistortRectifyMap(
        camera, told, None, new.numpy() - HALF, (224, 128), cv2.CV_32FC1
    )
    difference = lens.pix_of(rays).numpy() - 0.5 - np.stack(expected, axis=-1)
    assert np.abs(difference).max() < 1e-3


def test_the_image_is_that_of_opencv():
    image, camera = smooth_image(*SIZE), opencv_camera(FOCAL, CENTER)
    expected = cv2.undistort(image.permute(1, 2, 0).numpy(), camera, np.array(DISTORTION))
    actual, seen = undistorted(image, Lens(FOCAL, CENTER, DISTORTION), camera + HALF, SIZE)
    inner = seen.clone()
    inner[:2], inner[-2:], inner[:, :2], inner[:, -2:] = False, False, False, False
    difference = (actual.permute(1, 2, 0).int() - torch.from_numpy(expected).int()).abs()[inner]
    assert inner.float().mean() > 0.9
    assert difference.max() <= 2  # OpenCV's places are multiples of 1/32 pixel


def test_the_same_camera_leaves_an_image_as_it_is():
    image = torch.randint(0, 256, (3, 40, 60), dtype=torch.uint8)
    camera = pinhole(60, 40, math.radians(80))
    focal = float(camera[0, 0])
    for given in (image, image.numpy()):
        same, seen = undistorted(given, Lens((focal, focal), (30.0, 20.0)), camera, (60, 40))
        assert same.equal(image)
        assert seen.all()


def test_a_coarser_image_has_the_means_and_no_moire():
    """Stripes one pixel wide become grey, and a bright half stays where it is."""
    stripes = torch.zeros(3, 128 * 7, 224 * 7, dtype=torch.uint8)
    stripes[:, :, ::2] = 200
    camera, focal = pinhole(224, 128, math.radians(90)), 112.0 * 7
    lens = Lens((focal, focal), (112.0 * 7, 64.0 * 7))
    coarse, _ = undistorted(stripes, lens, camera, (224, 128))
    assert (coarse.int() - 100).abs().max() <= 15  # of 7 pixels 3 or 4 are bright

    exact = torch.arange(224, dtype=torch.uint8).repeat_interleave(7).expand(3, 128 * 7, -1)
    blocks, _ = undistorted(exact.contiguous(), lens, camera, (224, 128))
    assert blocks[0, 5].tolist() == [*range(224)]


def test_what_the_lens_does_not_see_is_black_and_said():
    white = torch.full((3, 100, 200), 255, dtype=torch.uint8)
    focal = 100 / math.tan(math.radians(30))  # 60 degrees wide
    wide, seen = undistorted(
        white, Lens((focal, focal), (100.0, 50.0)), pinhole(200, 100, math.radians(90)), (200, 100)
    )
    share = math.tan(math.radians(30)) ** 2  # of both sides of the image
    assert float(seen.float().mean()) == pytest.approx(share, abs=0.02)
    assert wide[:, seen].eq(255).all()
    assert wide[:, ~seen].eq(0).all()


def test_a_polynomial_that_turns_round_shows_nothing_twice():
    lens = Lens((100.0, 100.0), (100.0, 100.0), (-0.3,))
    turn = math.sqrt(1 / 0.9)  # of r - 0.3 r^3
    rays = torch.tensor([[turn - 0.01, 0.0], [turn + 0.01, 0.0], [1.8, 0.0]], dtype=torch.float64)
    assert lens.pix_of(rays).isnan().any(dim=-1).tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("lens", "named"),
    [
        (((100.0, -1.0), (5.0, 5.0)), "focal lengths above 0"),
        (((100.0, 1.0), (5.0, math.nan)), "finite"),
        (((100.0, 1.0), (5.0, 5.0), (0.1,) * 8), "8 numbers; give k1"),
    ],
)
def test_numbers_of_no_lens_are_refused(lens, named):
    with pytest.raises(UserError, match=named):
        Lens(*lens)
