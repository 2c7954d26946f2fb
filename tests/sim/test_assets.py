"""Assets as plain solids: classes, sizes, materials, and that they stand on the ground."""

from functools import partial

import numpy as np
import pytest

from src.ontology import ACTOR_TYPES, BUILDING, GENERAL, THIN_STRUCTURE, VEGETATION
from src.sim.assets import (
    ACTORS,
    bounds_m,
    buildings,
    construction,
    extent_m,
    furniture,
    industry,
    plaza,
    vegetation,
    waterside,
)
from src.sim.mesh import mesh_of_solid
from src.sim.solid import Solid
from src.sim.textures import PALETTE, TEXTURES

EXTENTS_M = {
    "car": ((4.2, 4.9), (1.7, 2.0), (1.4, 1.8)),
    "truck": ((6.5, 9.5), (2.2, 2.6), (2.9, 3.6)),
    "bus": ((10.0, 12.1), (2.4, 2.6), (3.0, 3.4)),
    "pedestrian": ((0.3, 0.9), (0.4, 0.8), (1.6, 1.9)),
    "bicycle": ((1.6, 1.9), (0.5, 0.7), (1.6, 2.0)),
    "motorcycle": ((1.9, 2.3), (0.6, 0.8), (1.5, 1.9)),
}

# The functions of a module that make something of exactly these classes.
PLANTS, THIN, THINGS = {VEGETATION}, {THIN_STRUCTURE}, {GENERAL}
MADE_OF = [
    (vegetation, "broadleaf street_tree conifer bush hedge", PLANTS),
    (vegetation, "bare_tree", PLANTS | THIN),
    (furniture, "lamp_post park_lamp traffic_light sign_post utility_pole span_wire", THIN),
    (furniture, "fence railing climbing_frame", THIN),
    (furniture, "bench litter_bin barrier traffic_cone container stall", THINGS),
    (industry, "container_stack", THINGS),
    (industry, "floodlight_mast mesh_fence pipe_bridge", THIN),
    (industry, "gantry_crane tank", THIN | {BUILDING}),
    (industry, "silo chimney hall", {BUILDING}),
    (waterside, "bollard motor_boat", THINGS),
    (waterside, "sailing_boat quay_crane", THINGS | THIN),
    (waterside, "jetty", {BUILDING} | THIN),
    (waterside, "palm", PLANTS),
    (buildings, "shed kiosk tower apartment gabled_house", {BUILDING}),
    (construction, "shell", {BUILDING} | THIN),
    (construction, "tower_crane site_fence", THINGS | THIN),
    (construction, "supplies skip", THINGS),
    (plaza, "slab market_hall", {BUILDING}),
    (plaza, "arcade", {BUILDING} | THIN),
    (plaza, "flag_pole bike_rack banner_line bunting festoon", THIN),
    (plaza, "sculpture fountain bollards", THINGS),
    (plaza, "planter tree_planter", THINGS | PLANTS),
]
HOUSE = {"bays": 4, "depth_m": 10.0, "facade": "facade_panel"}
SETTINGS = {
    "tower": {"storeys": 11, **HOUSE},
    "apartment": {"storeys": 4, **HOUSE},
    "gabled_house": {"storeys": 2, **HOUSE},
    "slab": {"bays": 5, "storeys": 3, "facade": "facade_brick"},
    "hall": {"width_m": 27.0, "depth_m": 16.0},
    "traffic_light": {"reach_m": 3.0},
    "utility_pole": {"height_m": 8.0},
    "festoon": {"radius_m": 16.0, "spokes": 8},
    **{name: {"width_m": 9.0} for name in ("span_wire", "pipe_bridge", "banner_line", "bunting")},
    **{name: {"length_m": 6.0} for name in ("hedge", "fence", "railing", "mesh_fence", "jetty")},
    **{name: {"length_m": 8.0} for name in ("site_fence", "arcade")},
}
STANDING = {
    name: (partial(getattr(module, name), **SETTINGS.get(name, {})), classes)
    for module, names, classes in MADE_OF
    for name in names.split()
}
SEEDS = range(6)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("kind", ACTOR_TYPES)
@pytest.mark.parametrize("seed", SEEDS)
def test_actor_is_realistic_and_of_one_class(kind, seed):
    assert set(ACTORS) == set(ACTOR_TYPES)
    solids = ACTORS[kind](rng(seed))
    assert len(solids) >= 5
    assert {s.class_id for s in solids} == {ACTOR_TYPES[kind]}
    assert all(s.material in TEXTURES or s.material in PALETTE for s in solids)
    for size, (low, high) in zip(extent_m(solids), EXTENTS_M[kind]):
        assert low <= size <= high
    lower, upper = map(np.stack, zip(*map(bounds_m, solids)))
    middle_m = (lower.min(axis=0) + upper.max(axis=0)) / 2
    assert np.abs(middle_m[:2]).max() < 0.125, "the origin is not under the middle"
    assert abs(lower[:, 2].min()) < 0.08, "it does not stand on the ground"


@pytest.mark.parametrize("name", STANDING)
def test_asset_is_rooted_in_the_ground_and_whole_and_its_generator_decides(name):
    make, classes = STANDING[name]
    drawn = [make(rng(seed)) for seed in SEEDS]
    for solids in drawn:
        assert {s.class_id for s in solids} == classes
        assert all(s.material in TEXTURES or s.material in PALETTE for s in solids)
        assert -0.5 <= min(bounds_m(s)[0][2] for s in solids) < -0.1

    assert repr(make(rng(3))) == repr(drawn[3])
    if name not in ("apartment", "bollard", "jetty", "site_fence"):
        assert len(set(map(repr, drawn))) > 1


def test_wire_is_thin_sags_and_meets_its_ends():
    solids = furniture.wire((0, 0, 8), (20, 0, 8), sag_m=0.6)
    assert all(0.03 <= s.size_m[0] <= 0.05 for s in solids)
    assert min(bounds_m(s)[0][2] for s in solids) == pytest.approx(8 - 0.6, abs=0.05)
    ends = np.array([[0.02, 0, 7.99], [19.98, 0, 7.99]])
    assert all(any(s.contains(end[None], 0.02).any() for s in solids) for end in ends)


@pytest.mark.parametrize("shape", ["box", "cylinder", "cone", "ellipsoid"])
def test_bounds_enclose_the_mesh_tightly(shape):
    generator = rng(0)
    for _ in range(20):
        rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        scene_from_solid = np.eye(4)
        scene_from_solid[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
        scene_from_solid[:3, 3] = generator.normal(size=3)
        size_m = tuple(generator.uniform(0.5, 2, 3))
        solid = Solid(shape, GENERAL, size_m, scene_from_solid, "grass")

        lower, upper = bounds_m(solid)
        vertices_m = mesh_of_solid(solid).vertices_m
        gaps_m = np.stack([vertices_m.min(axis=0) - lower, upper - vertices_m.max(axis=0)])
        # The corners of the tessellation lie on the true surface, so it is a little smaller.
        assert gaps_m.min() >= -1e-9
        assert gaps_m.max() <= (1e-9 if shape == "box" else 0.12 * max(size_m))
