"""Cast shadows: where the light does not come, by hand-made scenes whose shadows are known."""

from dataclasses import replace
from functools import partial

import numpy as np

from src.ontology import BUILDING
from src.sim.lighting import illuminate
from src.sim.scene import Scene, parts_of
from tests.sim.scenery import (
    HEIGHT,
    WIDTH,
    actor,
    body_at,
    ground,
    places_of,
    render,
    solid,
    view_of,
    world_of,
)
from tests.sim.weathers import WEATHERS

CLEAR = replace(WEATHERS["clear"], ambient=0.3)
NO_SHADOW = replace(CLEAR, shadow=False)
TOWARDS = np.array(CLEAR.towards)
SLAB_SIZE_M, SLAB_AT_M = np.array((5.0, 4.0, 0.4)), np.array((12.0, 1.0, 4.0))
UNDER_SLAB = Scene(parts_of([ground(), solid(BUILDING, SLAB_SIZE_M, SLAB_AT_M)]), ())
GREY = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
HERE = body_at((0.5, 0.4, 6.2), 0.1, 0.25, 0.05)


def relit(relight, scene, weather):
    """A grey picture of the scene with its light, what its pixels show, and where that is."""
    view = view_of(scene, 0, HERE)
    places_m = places_of(view, HERE).astype(np.float32)
    picture = relight(GREY, places_m, view.depth_m, weather, partial(scene.blocked, 0))
    return picture, view, places_m


def shadow_of_the_slab(view, places_m):
    """The pixels of the ground in the slab's shadow, and those in the light."""
    on_ground = (np.abs(places_m[..., 2]) < 0.02) & np.isfinite(view.depth_m)
    rise_m = (SLAB_AT_M[2] - places_m[..., 2:]) / TOWARDS[2]
    met_m = places_m[..., :2] + rise_m * TOWARDS[:2]
    inside_m = (SLAB_SIZE_M[:2] / 2 - np.abs(met_m - SLAB_AT_M[:2])).min(axis=-1)
    # The slab is 0.4 m thick, which widens its shadow by that over the sun's slope.
    return on_ground & (inside_m > 0.1), on_ground & (inside_m < -0.5)


def test_a_slabs_shadow_lies_where_the_sun_puts_it_and_keeps_the_ambient_light():
    with world_of(UNDER_SLAB) as world:
        lit, shaded = (render(world, HERE, 0, weather) for weather in (NO_SHADOW, CLEAR))
    umbra, open_air = shadow_of_the_slab(lit, places_of(lit, HERE))
    assert umbra.sum() > 100
    assert open_air.sum() > 1000
    np.testing.assert_array_equal(shaded.rgb[open_air], lit.rgb[open_air])
    direct = CLEAR.diffuse * TOWARDS[2] * np.array(CLEAR.light_color)
    expected = lit.rgb[umbra] * CLEAR.ambient / (CLEAR.ambient + direct)
    assert np.abs(shaded.rgb[umbra] - expected).max() <= 1.5
    for name in ("depth_m", "class_id", "actor_id"):
        np.testing.assert_array_equal(getattr(shaded, name), getattr(lit, name))


def test_an_actors_shadow_moves_with_it():
    scene = Scene(parts_of([ground()]), (actor([(12.0, 3, 0), (14.0, -6, 0)]),))
    with world_of(scene) as world:
        for step in (0, 1):
            lit, shaded = (render(world, HERE, step, weather) for weather in (NO_SHADOW, CLEAR))
            dark = (shaded.rgb < lit.rgb).any(axis=-1) & (lit.actor_id == 0)
            middle_m = places_of(lit, HERE)[dark].mean(axis=0)
            beside_m = middle_m - scene.actors[0].world_from_actor[step, :3, 3]
            assert dark.sum() > 10
            # From the actor, the shadow lies where the sun is not.
            assert beside_m[:2] @ TOWARDS[:2] < -0.3
            assert np.linalg.norm(beside_m[:2]) < 3


def test_bare_colors_are_lit_by_the_slope_of_their_face_and_its_shadows():
    lit, view, places_m = relit(illuminate, UNDER_SLAB, CLEAR)
    unshaded, _, _ = relit(illuminate, UNDER_SLAB, NO_SHADOW)
    in_shadow, in_light = shadow_of_the_slab(view, places_m)
    full = CLEAR.ambient + CLEAR.diffuse * TOWARDS[2] * np.array(CLEAR.light_color)
    for picture, where, share in (
        (lit, in_light, full),
        (lit, in_shadow, CLEAR.ambient),
        (unshaded, in_shadow, full),
    ):
        error = np.abs(picture[where] - np.minimum(200 * share, 255)).max(axis=-1)
        assert (error <= 2).mean() > 0.97
    assert (lit[np.isinf(view.depth_m)] == 200).all()
