"""The cost volume beside its definition: a plane at a known depth, and a slow reference."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from src.errors import UserError
from src.geometry import front_mount, inverse, pinhole, rigid, rotation_from_euler, world_from_occ
from src.parallax import AT_M, FAR_M, LEAST_PIX, LUMA, NEAR_M, NOISE, RASTER, Parallax

WIDTH, HEIGHT = 64, 32
MOUNT, CAMERA = front_mount((0.1, 0.0, 0.05), 0.1), pinhole(WIDTH, HEIGHT, 1.5)


def pose(x_m, y_m, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0):
    angles = (torch.tensor(each, dtype=torch.float64) for each in (roll_rad, pitch_rad, yaw_rad))
    return rigid(rotation_from_euler(*angles), torch.tensor([x_m, y_m, 5.0], dtype=torch.float64))


def texture(points):
    """A grey that changes everywhere, at points of a plane [..., 2] in metres."""
    x, y = points.unbind(-1)
    waves = [torch.sin(k * x + 1.7 * k * k) * torch.cos(0.8 * k * y + k) for k in (1.1, 2.3, 4.1)]
    return (0.5 + 0.16 * sum(waves)).clamp(0, 1)


def picture(world_from_body, depth_m):
    """What a camera sees of a wall ``depth_m`` in front of the camera of ``pose(0, 0)``."""
    now_from_wall = inverse(world_from_body @ MOUNT) @ pose(0, 0) @ MOUNT
    v, u = torch.meshgrid(torch.arange(HEIGHT) + 0.5, torch.arange(WIDTH) + 0.5, indexing="ij")
    pixels = torch.stack([u, v, torch.ones_like(u)], dim=-1).double()
    rays = pixels @ torch.linalg.inv(CAMERA).T
    wall_from_now = inverse(now_from_wall)
    rays, origin = rays @ wall_from_now[:3, :3].T, wall_from_now[:3, 3]
    points = origin + rays * ((depth_m - origin[2]) / rays[..., 2])[..., None]
    return (255 * texture(points[..., :2])).round().to(torch.uint8).expand(3, -1, -1)


def volume(parallax, poses, images):
    cameras = CAMERA.expand(len(poses), 3, 3)
    return parallax.volume(images, torch.stack(poses), MOUNT, cameras)


def past_and_now(depth_m, **tilt):
    """Two past images and the current one of a wall, of a camera that moves and tilts."""
    poses = [pose(-0.8, 0.5, yaw_rad=0.1), pose(-0.3, 0.25, **tilt), pose(0, 0)]
    return poses, [picture(each, depth_m) for each in poses]


@pytest.mark.parametrize("depth_m", [3.0, 6.5, 14.0])
def test_a_wall_agrees_at_its_own_depth(depth_m):
    found = volume(Parallax([0.2, 0.4]), *past_and_now(depth_m, roll_rad=0.2, pitch_rad=-0.1))
    place = 48 * np.log(depth_m / NEAR_M) / np.log(FAR_M / NEAR_M)
    best = found[:, 1:-1, 2:-2].argmax(dim=0)
    seen = found[:, 1:-1, 2:-2].amax(dim=0) > 200
    assert seen.float().mean() > 0.6
    assert ((best[seen] + 0.5 - place).abs() <= 1.5).float().mean() > 0.95


def seen_at(homography, u, v):
    """Where a past image sees pixels; NaN behind its camera."""
    x, y, z = np.tensordot(homography, np.stack([u, v, np.ones_like(u)]), 1)
    return np.where(z > 0, np.stack([x, y]) / z, np.nan)


def agreement_of(now, past, planes, depth_m, window):
    """Mean correlation with the past images at one depth, by loops; images are grey [h, w], and
    ``planes`` return the homography of a depth for each past image."""
    reach, (height, width) = window // 2, now.shape
    agreement = np.zeros((height // RASTER, width // RASTER))
    for i, j in np.ndindex(*agreement.shape):
        row, column = RASTER * i + RASTER // 2, RASTER * j + RASTER // 2
        rows = np.arange(max(row - reach, 0), min(row + reach + 1, height))
        columns = np.arange(max(column - reach, 0), min(column + reach + 1, width))
        u, v = np.meshgrid(columns + 0.5, rows + 0.5)
        found = []
        for image, plane in zip(past, planes):
            x, y = seen_at(plane(depth_m), u, v)
            center = np.array([column + 0.5]), np.array([row + 0.5])
            moved = seen_at(plane(np.inf), *center) - seen_at(plane(AT_M), *center)
            inside = (x >= 0.5) & (x <= width - 0.5) & (y >= 0.5) & (y <= height - 0.5)
            if not inside.all() or np.hypot(*moved)[0] < LEAST_PIX:
                continue
            grid = torch.from_numpy(np.stack([2 * x / width - 1, 2 * y / height - 1], -1))
            past_image = torch.from_numpy(image)[None, None]
            there = F.grid_sample(past_image, grid[None], align_corners=False)[0, 0].numpy()
            here = now[rows][:, columns]
            covariance = (here * there).mean() - here.mean() * there.mean()
            found.append(covariance / np.sqrt((here.var() + NOISE) * (there.var() + NOISE)))
        agreement[i, j] = np.mean(found) if found else 0
    return agreement


@pytest.mark.parametrize("projection", ["attitude", "level"])
def test_it_is_the_mean_correlation_of_windows(projection):
    poses, images = past_and_now(5.0, roll_rad=0.3, pitch_rad=0.2)
    parallax = Parallax([0.2, 0.4], bins=3, per_bin=1, window=5, projection=projection)
    bodies = torch.stack(poses) if projection == "attitude" else world_from_occ(torch.stack(poses))
    cameras = bodies @ MOUNT
    past_from_now = (inverse(cameras[:-1]) @ cameras[-1]).numpy()
    grey = [np.tensordot(LUMA, image.double().numpy() / 255, 1) for image in images]

    def plane_of(past_from_now):
        def homography(depth_m):
            plane = past_from_now[:3, :3].copy()
            plane[:, 2] += past_from_now[:3, 3] / depth_m
            return CAMERA.numpy() @ plane @ np.linalg.inv(CAMERA.numpy())

        return homography

    planes = [plane_of(each) for each in past_from_now]
    found = volume(parallax, poses, images).double().numpy() / 255
    for of_bin, depth_m in zip(found, parallax.depths_m.numpy()):
        expected = agreement_of(grey[-1], grey[:-1], planes, depth_m, window=5)
        np.testing.assert_allclose(of_bin, expected.clip(0, 1), atol=0.01)


def test_nothing_is_known_without_a_past_and_where_it_hovers():
    here = pose(0, 0)
    parallax, image = Parallax([0.2]), picture(here, 5.0)
    assert not volume(parallax, [here], [image]).any()
    assert not volume(parallax, [pose(0.005, 0.005), here], [image, image]).any()


def test_a_turn_alone_is_no_parallax():
    poses = [pose(0, 0, yaw_rad=0.05), pose(0, 0)]
    images = [picture(each, 8.0) for each in poses]
    # The camera sits 10 cm in front of the center of the turn, and moves 5 mm.
    assert not volume(Parallax([0.2]), poses, images).any()


def test_images_of_another_size_are_refused():
    poses, images = past_and_now(5.0)
    images[0] = images[0][:, :16]
    with pytest.raises(UserError, match=r"image: 64x16, 64x32, 64x32 .* one size"):
        volume(Parallax([0.2, 0.4]), poses, images)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"ages_s": []}, r"ages_s: \[\]"),
        ({"ages_s": [0.4, 0.2]}, r"ages_s: .* in order"),
        ({"ages_s": [0.0, 0.2]}, r"ages_s: .* above 0"),
        ({"ages_s": [0.2, float("inf")]}, r"ages_s: .* above 0"),
        ({"window": 6}, "window: 6; give an odd number"),
        ({"bins": 0}, "bins: 0"),
        ({"per_bin": 0.5}, "per_bin: 0.5"),
        ({"projection": "tilted"}, "projection: 'tilted'; there are attitude, level"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, message):
    with pytest.raises(UserError, match=message):
        Parallax(**settings)
