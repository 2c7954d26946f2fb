"""Each kind of damage does what it says, to the amount that it says, the same for the same seed."""

import numpy as np
import pytest

from src.errors import UserError
from src.faults.damage import LENGTHS, SHARES, Damaged, distances_m
from src.geometry import VoxelGrid
from src.loop.true_occupancy import TrueOccupancy, connected
from src.models.frame import StreamFrame
from src.ontology import BUILDING, GROUND, THIN_STRUCTURE, VRU
from src.sim.assets import upright
from src.sim.scene import Scene, SceneActor, parts_of
from src.sim.solid import Solid

GRID = VoxelGrid((0.0, -5.0, -5.0), (10.0, 5.0, 5.0), (20, 20, 20))
CORNERS = np.full(3, -20.0), np.full(3, 20.0)
PLACES_M = [(x, y) for x in (2.2, 5.2, 8.2) for y in (-3.8, -1.8, 0.2, 2.2, 4.2)]


def post(class_id, x_m, y_m):
    return Solid("box", class_id, (0.2, 0.2, 2.0), upright(x_m, y_m, 0.2), "metal")


def scene():
    """Fifteen posts of three classes in turns, ground below them, and a person."""
    classes = (BUILDING, THIN_STRUCTURE, GROUND)
    solids = [post(classes[n % 3], *place) for n, place in enumerate(PLACES_M)]
    box = Solid("box", VRU, (0.4, 0.4, 1.6), upright(0.0, 0.0, 0.8), "metal")
    places_m, still, zero = np.array([[6.7, 0.2, 2.1]] * 2), np.zeros((2, 3)), np.zeros(2)
    person = SceneActor(
        1, "pedestrian", VRU, (0.4, 0.4, 1.6), parts_of([box]), places_m, zero, still
    )
    return Scene(parts_of(solids), (person,))


def frame():
    mount = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    pix = np.array([[32.0, 0, 32], [0, 32, 32], [0, 0, 1]])
    return StreamFrame(np.zeros((3, 64, 64), np.uint8), 0.0, np.eye(4), np.zeros(3), pix, mount)


@pytest.fixture(scope="module")
def truth():
    return TrueOccupancy(scene(), *CORNERS)


def occupied(truth, kind, amount, seed=0):
    perception = Damaged("any", GRID, kind, amount, seed)
    perception.begin(truth, "any")
    return perception(frame()).occupied > 0


def whole(truth):
    return occupied(truth, "voxels", 0.0)


def test_nothing_is_lost_to_no_damage(truth):
    for kind in (*SHARES, *(each for each in LENGTHS if each != "far")):
        assert (occupied(truth, kind, 0.0) == whole(truth)).all()
    assert (occupied(truth, "far", 99.0) == whole(truth)).all()


def test_objects_are_lost_whole_but_for_the_ground(truth):
    semantics, moving = truth.at(0, np.eye(4), GRID)
    assert (occupied(truth, "objects", 1.0) == (semantics == GROUND)).all()
    half = occupied(truth, "objects", 0.5)
    for x_m, y_m in PLACES_M:
        column = tuple(np.floor((np.array([x_m, y_m]) - GRID.lower_m[:2]) / 0.5).astype(int))
        left = half[column].sum() / whole(truth)[column].sum()
        assert left in (0.0, 1.0)
    assert 0 < half.sum() < whole(truth).sum()
    assert moving.any()


@pytest.mark.parametrize(("name", "class_id"), [("thin_structure", THIN_STRUCTURE), ("vru", VRU)])
def test_a_class_is_lost_and_no_other(name, class_id, truth):
    semantics, _ = truth.at(0, np.eye(4), GRID)
    lost = whole(truth) & ~occupied(truth, name, 1.0)
    assert (lost == (semantics == class_id)).all()


def test_shares_of_voxels_and_of_phantoms(truth):
    left = occupied(truth, "voxels", 0.6).sum() / whole(truth).sum()
    assert left == pytest.approx(0.4, abs=0.12)
    more = occupied(truth, "phantoms", 0.02)
    assert (more | whole(truth) == more).all()
    assert (more & ~whole(truth)).mean() == pytest.approx(0.02, abs=0.005)


def test_near_and_far_share_the_truth_between_them(truth):
    near, far = occupied(truth, "near", 6.0), occupied(truth, "far", 6.0)
    assert (near ^ far == whole(truth)).all()
    assert distances_m(GRID)[near].min() >= 6.0


def test_ahead_moves_and_grown_thickens(truth):
    assert (occupied(truth, "ahead", 1.0)[2:] == whole(truth)[:-2]).all()
    thick = occupied(truth, "grown", 0.5)
    assert (thick | whole(truth) == thick).all()
    assert 2 < thick.sum() / whole(truth).sum() < 27


def test_the_seed_and_the_flight_decide_whatever_flew_before(truth):
    perception = Damaged("any", GRID, "voxels", 0.5, 0)
    beliefs = []
    for flight in ("one", "one", "two"):
        perception.begin(truth, flight)
        beliefs.append(perception(frame()).occupied)
    assert (beliefs[0] == beliefs[1]).all()
    assert (beliefs[0] != beliefs[2]).any()
    assert (occupied(truth, "voxels", 0.5, 0) != occupied(truth, "voxels", 0.5, 1)).any()


def test_points_of_one_class_that_touch_are_one_object():
    line = np.c_[np.arange(0, 5, 0.25), np.zeros(20), np.zeros(20)]
    points = np.concatenate([line + np.array([0, y, 0]) for y in (0.0, 3.0, 0.4)])
    classes = np.repeat([1, 1, 2], 20).astype(np.uint8)
    objects = connected(points, classes)
    assert [len(set(part)) for part in np.split(objects, 3)] == [1, 1, 1]
    assert len(set(objects)) == 3
    assert len(set(connected(points, np.ones(60, np.uint8)))) == 2
    assert len(connected(np.zeros((0, 3)), np.zeros(0, np.uint8))) == 0


@pytest.mark.parametrize(("kind", "amount"), [("luck", 0.1), ("objects", 1.5), ("near", -1.0)])
def test_what_there_is_not_is_refused(kind, amount):
    with pytest.raises(UserError, match=r"perception\.(kind|amount)"):
        Damaged("any", GRID, kind, amount, 0)
