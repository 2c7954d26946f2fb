"""Traffic on a few hand-made lanes and pavements, and in a real town."""

import numpy as np
import pytest

from src.ontology import ACTOR_TYPES
from src.sim.actor import HABITS
from src.sim.driver import drive
from src.sim.layout import Town
from src.sim.pilot import STEP_S
from src.sim.route import Route, chain
from src.sim.towns import build_town
from src.sim.traffic import TrafficConfig, simulate_traffic
from tests.sim.roads import SIZES_M, overlapping, way


def terrain(x, y):
    return 0.4 * np.sin(x / 15) * np.cos(y / 20)


LANE_RISE_M, WALK_RISE_M = 0.04, 0.16
LANES = (
    way((-50, -2), (100, -2), successors=(1, 2)),
    way((100, -2), (250, -2)),
    way((100, -2), (100, -90)),
    way((250, 2), (100, 2), successors=(4,)),
    way((100, 2), (-50, 2)),
    way((60, -60), (60, 60), speed_mps=12.0),
)
WALKS = (
    way((-50, -6), (250, -6), half_width_m=1, speed_mps=1.4, rise_m=WALK_RISE_M),
    way((250, -6), (-50, -6), half_width_m=1, speed_mps=1.4, rise_m=WALK_RISE_M),
)
TOWN = Town("hand-made", terrain, (), (), LANES, WALKS, ())
UAV_M = np.c_[np.linspace(20, 100, 600), np.zeros(600), np.full(600, 9.0)]


# Sizes are given by type, so that no shape needs to be built to place and drive it.
def traffic(seed, uav_m=UAV_M, **counts):
    config = TrafficConfig(counts) if counts else TrafficConfig()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("src.sim.traffic.size_of", lambda name, seed: SIZES_M[name])
        return simulate_traffic(TOWN, np.random.default_rng(seed), config, uav_m)


def footprint(actor):
    return actor.position_m[:, :2], actor.yaw_rad, actor.size_m[:2]


@pytest.fixture(scope="module")
def busy():
    return traffic(0)


def test_every_type_is_there_and_numbered_from_one(busy):
    assert {actor.type for actor in busy} == set(ACTOR_TYPES)
    assert [actor.actor_id for actor in busy] == list(range(1, len(busy) + 1))
    assert len(busy) > 0.7 * sum(TrafficConfig().counts.values())


def test_actors_stand_on_road_or_pavement_and_start_near_the_flight(busy):
    for actor in busy:
        x_m, y_m, z_m = actor.position_m.T
        rise_m = WALK_RISE_M if np.abs(y_m + 6).max() < 1 else LANE_RISE_M
        assert z_m == pytest.approx(terrain(x_m, y_m) + rise_m)
        apart_m = np.hypot(*(actor.position_m[0, :2] - UAV_M[:, :2]).T)
        assert apart_m.min() < TrafficConfig().near_m + 2


def test_no_two_actors_ever_overlap():
    crowd = traffic(2, car=24, truck=6, bus=6, motorcycle=12, bicycle=20, pedestrian=40)
    assert len(crowd) > 50
    assert not overlapping([footprint(actor) for actor in crowd])


def test_actors_face_where_they_go_and_turn_smoothly():
    turned_rad = []
    for actor in (*traffic(0), *traffic(1), *traffic(2)):
        heading_rad = np.unwrap(actor.yaw_rad)
        turn_radps = np.abs(np.diff(heading_rad)) / STEP_S
        assert turn_radps.max() < 1.1 * HABITS[actor.type].turn_radps
        turned_rad.append(abs(heading_rad[-1] - heading_rad[0]))

        x_mps, y_mps, _ = actor.velocity_mps.T
        speed_mps = np.hypot(x_mps, y_mps)
        apart = np.angle(np.exp(1j * (np.arctan2(y_mps, x_mps) - actor.yaw_rad)))
        assert np.abs(apart[speed_mps > 0.3]).max() < 0.3
        assert np.abs(np.diff(speed_mps)).max() / STEP_S < 10
    assert max(turned_rad) > 1


def test_what_comes_near_the_uav_is_left_out():
    # So low and so far aside, it flies along the lane.
    low = np.c_[UAV_M[:, :2] - (0, 2), np.full(600, 2.0)]
    for actor in (actor for seed in range(3) for actor in traffic(seed, uav_m=low)):
        assert np.hypot(*(low - actor.position_m)[:, :2].T).min() > 2
    cars = [len(traffic(s, uav_m=path, car=12)) for path in (UAV_M, low) for s in range(3)]
    assert sum(cars[3:]) < sum(cars[:3])


def test_the_same_seed_moves_the_same(busy):
    first, again, other = (
        [(actor.position_m.tobytes(), actor.parts[0].mesh.vertices_m.tobytes()) for actor in actors]
        for actors in (busy, traffic(0), traffic(1))
    )
    assert first == again != other


def test_in_a_real_town_actors_stop_and_turn_and_never_overlap():
    """Around a flight of 12 s through streets with traffic lights."""
    rng = np.random.default_rng(1)
    town = build_town("downtown", rng)
    first = int(rng.integers(len(town.corridors)))
    route = Route.through(chain(town.corridors, rng, first, 90), 5.0)
    way_m, _ = route.at(np.linspace(0, 72, 600))
    uav_m = np.c_[way_m, np.full(600, 12.0)]
    downtown = simulate_traffic(town, rng, TrafficConfig(), uav_m)

    assert len(downtown) > 15
    assert not overlapping([footprint(actor) for actor in downtown])
    speed_mps = np.array([np.hypot(*actor.velocity_mps[:, :2].T) for actor in downtown])
    assert ((speed_mps[:, 0] > 2) & (speed_mps.min(axis=1) < 0.1)).sum() >= 3
    turned_rad = np.array([np.ptp(np.unwrap(actor.yaw_rad)) for actor in downtown])
    assert (turned_rad > 1).sum() >= 2


def test_nobody_reacts_to_what_was_left_out(monkeypatch):
    """Of those that meet the UAV the others know nothing: they drive again without them."""
    # The number of actors of every attempt.
    driven = []

    def recorded(travellers, *args):
        driven.append(len(travellers))
        return drive(travellers, *args)

    monkeypatch.setattr("src.sim.traffic.drive", recorded)
    actors = traffic(0, uav_m=np.tile([60.0, -2.0, 1.0], (600, 1)), car=12)
    assert driven[0] > driven[-1] == len(actors)
