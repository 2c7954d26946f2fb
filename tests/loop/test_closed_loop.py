"""A whole flight in a yard with a wall and a wire: blind it hits, seeing it arrives."""

import numpy as np
import pytest

from src.data.rates import STEP_HZ as SCENE_HZ
from src.geometry import VoxelGrid
from src.loop.airframe import POSITION, Airframe
from src.loop.flight import Rules, fly
from src.loop.mission import Mission
from src.loop.outcome import row_of
from src.loop.perception import Constant, Truth
from src.loop.planner import QuinticPlanner
from src.loop.stage import Stage
from src.ontology import CAR
from src.sim.assets import upright
from src.sim.scene import Scene, SceneActor, parts_of
from src.sim.solid import Solid
from src.sim.traffic import TrafficConfig
from tests.loop.yard import WALL_X_M, WIRE_X_M

GRID = VoxelGrid((0.0, -12.5, -10.0), (25.0, 12.5, 5.0), (50, 50, 30))
RULES = Rules()
TOWN = "tests.loop.yard"


def stage_at(height_m, y_m=0.0, draws=False):
    mission = Mission(TOWN, 0, 3, "clear", 0.0, y_m, 0.0, 60.0, height_m)
    return Stage.of(mission, TrafficConfig(uav_gap_m=0.0), 6.0, RULES.late_s + 1, draws)


def flown(stage, perception, camera, airframe=None):
    return fly(stage, perception, QuinticPlanner(), airframe or Airframe(), camera, RULES)


def blind():
    return Constant("all_free", GRID, 0.0)


def seeing(in_sight=True):
    return Truth("seen", GRID, in_sight)


def row(stage, result):
    return row_of(stage, result, 0.5)


@pytest.mark.parametrize(
    ("height_m", "x_m", "hit"), [(4.0, WALL_X_M, "building"), (6.0, WIRE_X_M, "thin_structure")]
)
def test_who_sees_nothing_hits_what_is_in_the_way(height_m, x_m, hit, camera):
    """At 6 m beside the wall there is the wire alone."""
    stage = stage_at(height_m, y_m=0.0 if hit == "building" else 6.0)
    assert stage.blind_hits(6.0, RULES.radius_m)
    result = flown(stage, blind(), camera, Airframe(wind_mps2=0.0))
    told = row(stage, result)
    assert (told["outcome"], told["hit"], told["fault"]) == ("collided", hit, "missed")
    assert result.states[-1, 0] == pytest.approx(x_m, abs=0.9)
    assert told["clearance_m"] < RULES.radius_m


@pytest.mark.parametrize("in_sight", [True, False])
@pytest.mark.parametrize("height_m", [4.0, 6.0])
def test_who_sees_arrives(height_m, in_sight, camera):
    told = row(stage_at(height_m), flown(stage_at(height_m), seeing(in_sight), camera))
    assert (told["outcome"], told["hit"], told["fault"]) == ("arrived", "", "")
    assert told["clearance_m"] > 0.5
    assert 58 < told["path_m"] < 75


def test_who_is_afraid_of_everything_is_stuck(camera):
    stage = stage_at(4.0)
    result = flown(stage, Constant("all_occupied", GRID, 1.0), camera)
    assert result.outcome == "stuck"
    assert result.time_s == pytest.approx(RULES.stuck_s, abs=0.3)
    assert result.path_m < 1.0


def test_a_flight_is_the_same_bit_for_bit_whatever_flew_before(camera):
    first = flown(stage_at(4.0), seeing(), camera)
    flown(stage_at(6.0), blind(), camera)
    again = flown(stage_at(4.0), seeing(), camera)
    assert first.states.tobytes() == again.states.tobytes()
    assert first.nearest == again.nearest


def test_who_flies_far_off_its_way_is_late(camera):
    """Nobody knows what there is to be hit."""

    class Astray(QuinticPlanner):
        def __call__(self, motion, belief, target_m):
            return super().__call__(motion, belief, motion.position_m + np.array([0.0, 15.0, 0.0]))

    result = fly(stage_at(4.0), blind(), Astray(), Airframe(), camera, RULES)
    assert (result.outcome, result.time_s < RULES.stuck_s) == ("late", True)
    assert 15.0 < result.states[-1, 1] < 17.0


def test_a_picture_changes_nothing_of_the_truth():
    """The shed is in a corner of what is known of the scene."""
    points = [stage_at(4.0, draws=draws).truth._static[0] for draws in (False, True)]
    assert points[0].tobytes() == points[1].tobytes()
    assert ((points[0][:, 0] < -40.0) & (points[0][:, 1] < -40.0)).any()


def test_the_wind_is_the_missions(camera):
    stage = stage_at(4.0, y_m=-20.0)
    other = Stage(Mission(**{**vars(stage.mission), "index": 4}), stage.scene, stage.seconds)
    tracks = [flown(each, blind(), camera).states[:400, POSITION] for each in (stage, other)]
    assert np.abs(tracks[0] - tracks[1]).max() > 0.01


def test_a_perception_that_forgets_what_it_had_seen_planned_into_it(camera):
    """What the map had called occupied 0.5 to 2 s before is not missed."""

    class Forgetful(Truth):
        def __call__(self, frame):
            belief = super().__call__(frame)
            if frame.world_from_body[0, 3] > WALL_X_M - 9:
                belief.occupied[:] = 0.0
            return belief

    stage = stage_at(4.0)
    told = row(stage, flown(stage, Forgetful("forgetful", GRID, False), camera))
    assert (told["outcome"], told["fault"]) == ("collided", "planned_into")
    assert told["believed_2s"] > 0.5


def test_what_drives_into_a_uav_that_saw_it_coming_was_planned_into(camera):
    """The place where they meet was free a second before; the car was seen at its own, but the
    planner wants to be surer."""
    steps = np.arange(round((RULES.late_s + 1) * SCENE_HZ) + 1)
    position_m = np.c_[90.0 - 8.0 * steps / SCENE_HZ, 0.0 * steps - 20.0, 0.0 * steps]
    velocity_mps = np.tile([-8.0, 0.0, 0.0], (len(steps), 1))
    box = Solid("box", CAR, (1.0, 24.0, 20.0), upright(0.0, 0.0, 5.0), "metal")
    car = SceneActor(
        1, "car", CAR, (1.0, 24.0, 20.0), parts_of([box]), position_m, 0.0 * steps, velocity_mps
    )
    stage = stage_at(4.0, y_m=-20.0)
    stage = Stage(stage.mission, Scene(stage.scene.static, (car,)), stage.seconds)
    planner = QuinticPlanner(threshold=0.97)
    result = fly(stage, seeing(in_sight=False), planner, Airframe(), camera, RULES)
    told = row(stage, result)
    assert (told["outcome"], told["hit"], told["fault"]) == ("collided", "car", "planned_into")
    assert told["believed_1s"] > 0.5
