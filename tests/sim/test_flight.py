"""Flights over towns made of a few boxes, whose rays are intersected analytically."""

import dataclasses
from functools import partial

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import euler_from_rotation, rotation_from_quat
from src.sim.clearance import obstacle_heights, stays_clear
from src.sim.flight import FlightConfig, fly
from src.sim.layout import Town
from src.sim.pilot import STEP_HZ, STEP_S, Pilot, lead_steps
from src.sim.route import Route
from tests.sim.roads import way

NORMAL = FlightConfig()
LOW = dataclasses.replace(NORMAL, altitude_range_m=(3.5, 4.5))


def level(x, y):
    return 0 * x + 0 * y


def rolling(x, y):
    return 0.4 * np.sin(x / 12) * np.cos(y / 15)


corridor = partial(way, half_width_m=3.0)
STRAIGHT = (corridor((0, 0), (200, 0)),)
BLOCK = (
    corridor((0, 0), (70, 0), successors=(1,)),
    corridor((70, 0), (70, 70), successors=(2, 4)),
    corridor((70, 70), (0, 70), successors=(3,)),
    corridor((0, 70), (0, 0), successors=(0,)),
    corridor((70, 70), (200, 70), successors=()),
)


def cast_on(*boxes_m, terrain=level):
    """Rays against axis-aligned boxes (lower, upper) and level-ish ground, as Embree answers."""

    def cast(origins_m, directions):
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = -(origins_m[:, 2] - terrain(*origins_m[:, :2].T)) / directions[:, 2]
            distance_m = np.where(directions[:, 2] < -1e-9, ground, np.inf)
            for lower_m, upper_m in boxes_m:
                near = (np.array(lower_m) - origins_m) / directions
                far = (np.array(upper_m) - origins_m) / directions
                enter = np.fmax.reduce(np.fmin(near, far), axis=1)
                leave = np.fmin.reduce(np.fmax(near, far), axis=1)
                hit = np.where(enter > 0, enter, leave)
                met = (enter <= leave) & (leave > 0)
                distance_m = np.where(met, np.minimum(distance_m, hit), distance_m)
        return distance_m

    return cast


def flights(count, corridors, *boxes_m, terrain=level, config=NORMAL):
    town = Town("hand-made", terrain, (), (), (), (), corridors)
    cast = cast_on(*boxes_m, terrain=terrain)
    return [fly(town, np.random.default_rng(seed), cast, config) for seed in range(count)]


@pytest.fixture(scope="module")
def twenty():
    return flights(20, BLOCK, terrain=rolling)


def all_of(several, name):
    return np.concatenate([getattr(flight, name) for flight in several])


def test_a_flight_is_twelve_seconds_of_whole_states(twenty):
    for values in vars(twenty[0]).values():
        assert len(values) == 12 * STEP_HZ
        assert np.isfinite(values).all()
    # Captures at these rates are steps of the simulation.
    assert [STEP_HZ % rate_hz for rate_hz in (2.5, 5, 10, 25)] == [0, 0, 0, 0]


def test_climb_and_descent_are_bounded_and_the_ceiling_holds(twenty):
    over = flights(6, STRAIGHT, ((60, -9, 0), (62, 9, 12)), ((110, -9, 0), (111, 9, 15)))
    rates_mps = np.array([np.diff(flight.altitude_m) / STEP_S for flight in twenty + over])
    assert rates_mps.max() <= NORMAL.climb_mps + 1e-9
    assert rates_mps.min() >= -NORMAL.descend_mps - 1e-9
    assert all_of(twenty + over, "altitude_m").max() < 20
    assert rates_mps[20:].max() > 0.8 * NORMAL.climb_mps


def test_altitude_is_above_the_terrain(twenty):
    flight = twenty[0]
    # The terrain is read where the UAV is, not where its command was.
    ground_m = rolling(*flight.position_m[:, :2].T)
    assert flight.position_m[:, 2] - ground_m == pytest.approx(flight.altitude_m, abs=1e-9)


def test_velocity_is_the_derivative_of_position(twenty):
    for flight in twenty[:4]:
        slope = np.gradient(flight.position_m, STEP_S, axis=0)[1:-1]
        assert flight.velocity_mps[1:-1] == pytest.approx(slope, abs=1e-9)
        assert np.abs(np.gradient(flight.velocity_mps, STEP_S, axis=0)).max() < 12


def test_angles_quaternion_transform_and_rates_agree(twenty):
    flight = twenty[3]
    rotation = rotation_from_quat(torch.from_numpy(flight.quat_xyzw))
    for angle, name in zip(euler_from_rotation(rotation), ("roll_rad", "pitch_rad", "yaw_rad")):
        assert angle.numpy() == pytest.approx(getattr(flight, name), abs=1e-9)
    assert flight.world_from_body[:, :3, :3] == pytest.approx(rotation.numpy())
    assert flight.world_from_body[:, :3, 3] == pytest.approx(flight.position_m)

    # Twice the sine of the turn between two steps stands in the antisymmetric part of its matrix.
    step = (rotation[:-1].transpose(1, 2) @ rotation[1:]).numpy()
    turned = (step - step.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
    assert turned / 2 / STEP_S == pytest.approx(flight.body_rates_radps[:-1], rel=0.02, abs=1e-3)


def test_the_nose_points_along_the_way(twenty):
    x_mps, y_mps, _ = all_of(twenty, "velocity_mps").T
    apart = np.angle(np.exp(1j * (np.arctan2(y_mps, x_mps) - all_of(twenty, "yaw_rad"))))
    assert np.abs(apart[np.hypot(x_mps, y_mps) > 1]).max() < 0.15


def test_left_turns_bank_with_negative_roll():
    # Gusts would hide the bank that the turn demands.
    calm = dataclasses.replace(NORMAL, gust_sigma_rad=0.0)
    several = flights(8, BLOCK, terrain=rolling, config=calm)
    roll_rad = all_of(several, "roll_rad")
    turning = np.concatenate([np.gradient(np.unwrap(f.yaw_rad), STEP_S) for f in several])
    assert np.degrees(roll_rad[turning > 0.4]).max() < -5
    assert np.degrees(roll_rad[turning < -0.4]).min(initial=90) > 5
    assert np.corrcoef(turning, roll_rad)[0, 1] < -0.9


def test_attitude_is_large_enough_to_matter(twenty):
    angles_deg = np.degrees([(flight.roll_rad, flight.pitch_rad) for flight in twenty])
    assert ((angles_deg.std(axis=(0, 2)) > 5) & (angles_deg.std(axis=(0, 2)) < 9)).all()
    assert np.abs(angles_deg).max() < 30
    assert 15 < np.median(np.abs(angles_deg).max(axis=(1, 2))) < 25


def test_the_same_seed_flies_the_same_bytes(twenty):
    _, again = flights(2, BLOCK, terrain=rolling)
    for name, values in vars(again).items():
        assert values.tobytes() == getattr(twenty[1], name).tobytes()
    assert (twenty[2].position_m != again.position_m).any()


@pytest.mark.parametrize("top_m", [8.0, 13.0])
def test_it_climbs_over_what_crosses_the_corridor(top_m):
    several = flights(8, STRAIGHT, ((99, -20, 0), (101, 20, top_m)), config=LOW)
    x_m, _, z_m = np.moveaxis([flight.position_m for flight in several], -1, 0)
    above = (x_m > 99) & (x_m < 101)
    assert (z_m[above] > top_m + LOW.touch_m).all()
    assert above.any(axis=1).sum() >= 2


def test_a_wire_of_four_centimetres_is_seen():
    # One wire runs across the route, the other one along it.
    wire = ((50.15, -20, 6.98), (50.19, 20, 7.02))
    along = ((80, 0.31, 5.98), (120, 0.35, 6.02))
    route = Route.through([corridor((0, 0), (150, 0))], 5.0, 0.5)
    seen_m = obstacle_heights(route, level, cast_on(wire, along), 1.5)
    assert seen_m[(route.arc_m > 49.4) & (route.arc_m < 50.3)].max() == pytest.approx(7.02)
    assert seen_m[(route.arc_m > 80.5) & (route.arc_m < 119.5)] == pytest.approx(6.02)
    assert seen_m[route.arc_m < 45].max() == pytest.approx(0)


def commanded(height_m, end_m=300.0):
    """The commanded arcs and altitudes of 20 s along a straight line, from 10 m on, and its speeds.

    An obstacle of that height begins at 60 m.
    """
    route = Route.through([corridor((0, 0), (300, 0))], 5.0, 0.5)
    at_m = np.arange(600) / 2
    obstacle_m = np.where((at_m >= 60) & (at_m < end_m), height_m, 0.0)
    pilot = Pilot(route, obstacle_m, np.random.default_rng(0), LOW, 8.0, 20.0)
    arc_m, altitude_m = pilot.fly_from(10.0)
    return arc_m, altitude_m, np.diff(arc_m) / STEP_S


def test_the_altitude_command_is_the_paper_s():
    arc_m, altitude_m, speed_mps = commanded(8.0, end_m=65.0)
    over = (arc_m[1:] > 60) & (arc_m[1:] < 64)
    margin_m = LOW.clearance_m + LOW.clearance_per_speed_s * speed_mps[over]
    assert altitude_m[1:][over] == pytest.approx(8.0 + margin_m, abs=0.05)
    assert altitude_m[-1] < 4.5
    assert len(arc_m) == 20 * STEP_HZ + 2 * lead_steps(LOW)


def test_it_slows_down_where_it_cannot_climb_in_time():
    *_, free_mps = commanded(0.0)
    arc_m, altitude_m, speed_mps = commanded(16.0)
    assert free_mps.min() > 7
    assert speed_mps[arc_m[1:] < 60].min() < 4
    assert arc_m[-1] > 65
    assert (altitude_m[arc_m > 59] > 16 + 0.9 * LOW.clearance_m).all()


def test_what_passes_the_ceiling_does_not_raise_the_target():
    arc_m, altitude_m, _ = commanded(17.9)
    assert arc_m[-1] == pytest.approx(60 - LOW.standoff_m, abs=0.6)
    assert altitude_m.max() < 5


def test_it_stops_before_what_is_too_tall():
    several = flights(10, STRAIGHT, ((119, -20, 0), (150, 20, 40)))
    # Some flights begin behind the tower.
    coming = [flight for flight in several if flight.position_m[0, 0] <= 119]
    assert all_of(coming, "position_m")[:, 0].max() < 119 - 1
    assert all_of(coming, "altitude_m").max() < 20
    assert sum(np.linalg.norm(flight.velocity_mps[-1]) < 0.3 for flight in coming) >= 2


def test_touching_and_being_inside_are_both_noticed():
    track = np.c_[np.linspace(0, 10, 200), np.zeros(200), np.full(200, 5.0)]
    assert stays_clear(track, cast_on(((0, 1.0, 0), (10, 2.0, 9))), 0.6)
    grazed, around = ((4, 0.4, 0), (6, 2.0, 9)), ((-50, -50, 0), (50, 50, 60))
    assert not stays_clear(track, cast_on(grazed), 0.6)
    assert not stays_clear(track, cast_on(around), 0.6)
    # A sheet of a millimeter lies between two steps.
    assert not stays_clear(track, cast_on(((5, -3, 0), (5.001, 3, 9))), 0.0)


def test_a_town_without_room_says_so():
    with pytest.raises(UserError, match=r"hand-made.*corridors"):
        flights(1, (corridor((0, 0), (20, 0)),))
