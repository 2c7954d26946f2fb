"""What sky, water, fog, rain and the sensor do to a picture."""

from dataclasses import replace

import numpy as np
import pytest

from src.ontology import BUILDING, CAR, GROUND, SKY, VEGETATION
from src.sim.air import LAMP_HEIGHT_M, apply_weather
from src.sim.sky import Sky, sky_at
from src.sim.world import Rendering
from tests.sim.scenery import (
    BODY_FROM_CAMERA,
    HEIGHT,
    PIX_FROM_CAMERA,
    WIDTH,
    body_at,
    camera_rays,
)
from tests.sim.weathers import WEATHERS

PLAIN = replace(
    WEATHERS["clear"],
    fog_per_m=0.0,
    cloud_cover=0.0,
    glow=(0.0, 0.0, 0.0),
    read_noise=0.0,
    shot_noise=0.0,
)
WET = replace(PLAIN, wetness=0.2)
HERE = body_at((0.0, 0.0, 5.0))
SHAPE = (HEIGHT, WIDTH)
GRASS = (40, 120, 40)
ATTITUDES = [{}, {"roll": 0.3}, {"roll": -0.2, "pitch": 0.1, "yaw": 0.15}]


def painted(weather, here=HERE, depth_m=10.0, rgb=100, class_id=BUILDING, seed=0):
    """What a camera sees; what is given of the rendering is broadcast to the picture."""
    rendering = Rendering(
        np.broadcast_to(np.asarray(rgb, np.uint8), (*SHAPE, 3)),
        np.broadcast_to(np.asarray(depth_m, np.float64), SHAPE),
        np.broadcast_to(np.asarray(class_id, np.uint8), SHAPE),
        np.zeros(SHAPE, dtype=np.int64),
    )
    matrices = here @ BODY_FROM_CAMERA, PIX_FROM_CAMERA
    image = apply_weather(rendering, *matrices, weather, np.random.default_rng(seed))
    assert image.dtype == np.uint8
    assert image.shape == (*SHAPE, 3)
    return image.astype(float)


def looks(here):
    """Unit direction in the world of every pixel, and its z-depth per metre."""
    _, directions, depth_per_m = camera_rays(here)
    return directions.reshape(*SHAPE, 3), depth_per_m.reshape(SHAPE)


def over_ground(here, **given):
    """Level ground at height 0 and, above the horizon, walls 20 m away: for `painted`."""
    directions, depth_per_m = looks(here)
    below = directions[..., 2] < 0
    range_m = float(here[2, 3]) / np.where(below, -directions[..., 2], 1)
    scene = {
        "here": here,
        "depth_m": np.where(below, range_m * depth_per_m, 20.0),
        "class_id": np.where(below, GROUND, BUILDING),
    }
    return {**scene, **given}, below


def mirrored(weather, here, ground=(100, 100, 100), bright=None, **given):
    """The share of what is above the horizon, or only of what is ``bright``, in each pixel of the
    ground: how much of a change up there it shows. 0 above the horizon."""
    scene, below = over_ground(here, **given)
    bright = ~below if bright is None else bright
    black = np.where(below[..., None], np.array(ground), 0)
    white = np.where(bright[..., None], 255, black)
    change = painted(weather, rgb=white, **scene) - painted(weather, rgb=black, **scene)
    return np.where(below, change.mean(axis=-1) / (255 * (1 - weather.wetness)), 0), below


def test_weather_without_weather_leaves_the_picture():
    rgb = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3))
    assert (painted(PLAIN, rgb=rgb) == rgb).all()


def test_fog_follows_beer_lambert_along_the_ray():
    foggy = replace(PLAIN, fog_per_m=0.03, fog_color=(0.8, 0.7, 0.6))
    for depth_m in (1.0, 20.0, 60.0):
        left = np.exp(-0.03 * depth_m / looks(HERE)[1])[..., None]
        expected = 100 * left + 255 * np.array(foggy.fog_color) * (1 - left)
        assert painted(foggy, depth_m=depth_m) == pytest.approx(expected, abs=0.51)


def test_the_sky_is_where_nothing_is_and_nowhere_else():
    depth_m = np.full(SHAPE, 10.0)
    depth_m[:50, :40] = np.inf
    image, sky = painted(PLAIN, depth_m=depth_m), painted(PLAIN, depth_m=np.inf)
    solid = np.isfinite(depth_m)
    assert (image[solid] == 100).all()
    assert (image[~solid] == sky[~solid]).all()


@pytest.mark.parametrize(
    "attitude", [*ATTITUDES, {"pitch": -0.8, "yaw": 2.5}, {"roll": np.pi, "pitch": -0.4}]
)
def test_a_direction_has_the_same_sky_from_every_attitude(attitude):
    """So the horizon of a rolled image tilts: the sky is that of the world."""
    cloudy = replace(PLAIN, cloud_cover=0.6, glow=(0.3, 0.2, 0.1), fog_per_m=0.001)
    here = body_at((3.0, -8.0, 12.0), **attitude)
    some = (slice(None, None, 5), slice(None, None, 5))
    directions = looks(here)[0][some].reshape(-1, 3)
    sky = Sky.of(cloudy)
    expected = 255 * np.array([sky_at(*direction, sky) for direction in directions.tolist()])
    expected = np.minimum(expected, 255)
    image = painted(cloudy, here, np.inf, class_id=SKY)
    assert image[some].reshape(-1, 3) == pytest.approx(expected, abs=1)
    assert expected.std(axis=0).max() > 8


@pytest.mark.parametrize(("read", "shot"), [(0.02, 0.0), (0.0, 0.06), (0.015, 0.05)])
def test_noise_grows_with_the_light(read, shot):
    noisy = replace(PLAIN, read_noise=read, shot_noise=shot)
    for value in (50, 120, 200):
        image = painted(noisy, rgb=value) / 255
        std = np.sqrt(read**2 + shot**2 * value / 255 + 1 / 12 / 255**2)
        assert image.std() == pytest.approx(std, rel=0.03)
        assert image.mean() == pytest.approx(value / 255, abs=4 * std / np.sqrt(image.size))


def test_wet_things_and_the_night_are_darker():
    assert (painted(WET) == 80).all()
    assert painted(WEATHERS["night"]).mean() < 0.5 * painted(WEATHERS["clear"]).mean()


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_wet_ground_mirrors_what_stands_above_it(attitude):
    here = body_at((2.0, 1.0, 5.0), **attitude)
    target = np.array([0.93, 0.2, 0.3]) / np.linalg.norm([0.93, 0.2, 0.3])
    directions = looks(here)[0]
    bright = directions @ target > np.cos(0.12)
    share, _ = mirrored(WET, here, bright=bright)
    middle = directions[share > 0.02].mean(axis=0)
    assert middle / np.linalg.norm(middle) == pytest.approx(target * [1, 1, -1], abs=0.025)
    # The blur is of a row or so: a patch as large as the one it mirrors.
    assert (share > 0.02).sum() == pytest.approx(bright.sum(), rel=0.4)


def test_only_wet_ground_that_is_not_green_mirrors():
    assert (mirrored(PLAIN, HERE)[0] == 0).all()
    for class_id in (BUILDING, VEGETATION, CAR):
        assert (mirrored(WET, HERE, class_id=class_id)[0] == 0).all()
    assert (mirrored(WET, HERE, ground=GRASS)[0] == 0).all()
    share, below = mirrored(WET, HERE)
    assert share[below].max() > 0.4
    # Of one picture, exactly the pixels of the ground.
    class_id = np.where(below & (np.arange(WIDTH) < 30), GROUND, CAR)
    some = mirrored(WET, HERE, class_id=class_id)[0]
    assert (some[:, :30] == share[:, :30]).all()
    assert (some[:, 30:] == 0).all()


def puddles(x_m, y_m, yaw=0.0):
    """White wet ground 10 m below a camera that looks straight down: puddles are darker."""
    lever_m = BODY_FROM_CAMERA[:3, 3].clone()
    here = body_at((0.0, 0.0, 0.0), pitch=np.pi / 2, yaw=yaw)
    here[:3, 3] = here.new_tensor([x_m, y_m, 10.0]) - here[:3, :3] @ lever_m
    return painted(WET, here, 10.0, 255, GROUND).mean(axis=-1)


def test_puddles_stay_where_they_are_when_the_camera_moves():
    # Up in the picture is +x, left is +y; a pixel of the ground is 10 m / 48.
    image, steps = puddles(7.0, -4.0), 12
    step_m = steps * 10.0 / float(PIX_FROM_CAMERA[0, 0])
    ahead, left = puddles(7.0 + step_m, -4.0), puddles(7.0, -4.0 + step_m)
    assert np.abs(ahead[steps:] - image[:-steps]).max() <= 6
    assert np.abs(left[:, steps:] - image[:, :-steps]).max() <= 6
    assert np.abs(puddles(7.0, -4.0, yaw=np.pi)[::-1, ::-1] - image).max() <= 1
    assert image.std() > 12
    assert min(np.abs(ahead - image).mean(), np.abs(left - image).mean()) > 8


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_lamps_light_only_what_is_near_the_ground(attitude):
    here = body_at((0.0, 0.0, 20.0), **attitude)
    dark = replace(PLAIN, exposure=(0.2, 0.24, 0.36))
    lamps = np.array([0.34, 0.25, 0.12])
    lit = replace(dark, lamps=tuple(lamps))
    extra = painted(lit, here, 40.0, 255) - painted(dark, here, 40.0, 255)
    directions, depth_per_m = looks(here)
    camera_m = float((here @ BODY_FROM_CAMERA)[2, 3])
    high_m = camera_m + directions[..., 2] * 40 / depth_per_m
    near = np.exp(-np.maximum(high_m, 0) / LAMP_HEIGHT_M)
    assert extra == pytest.approx(255 * lamps * near[..., None], abs=1.01)
    assert extra[high_m > 6 * LAMP_HEIGHT_M].max() <= 1
    assert (extra[high_m < 0.3][..., 0] > 80).all()
    assert (painted(lit, here, np.inf) == painted(dark, here, np.inf)).all()


def test_all_weathers_differ_and_none_touches_the_rendering():
    rgb = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
    before, (scene, _) = rgb.copy(), over_ground(HERE)
    images = {painted(weather, rgb=rgb, **scene).tobytes() for weather in WEATHERS.values()}
    # The paper's ten weathers.
    assert len(images) == len(WEATHERS) == 10
    assert (rgb == before).all()
