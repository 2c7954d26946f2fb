"""Each kind of damage does what it says, to the amount that it says, the same for the same seed."""

import numpy as np
import pytest

from src.errors import UserError
from src.geometry import VoxelGrid
from src.loop.true_occupancy import TrueOccupancy
from src.models.frame import StreamFrame
from src.ontology import BUILDING, GROUND, THIN_STRUCTURE, VRU
from src.sim.assets import upright
from src.sim.scene import Scene, parts_of
from src.sim.solid import Solid
from studies.foretelling.damaged import LENGTHS, SHARES, Damaged, connected
from tests.loop.yard import box_actor

GRID = VoxelGrid((0.0, -5.0, -5.0), (10.0, 5.0, 5.0), (20, 20, 20))
CORNERS = np.full(3, -20.0), np.full(3, 20.0)
PLACES_M = [(x, y) for x in (2.2, 5.2, 8.2) for y in (-3.8, -1.8, 0.2, 2.2, 4.2)]


def post(class_id, x_m, y_m):
    return Solid("box", class_id, (0.2, 0.2, 2.0), upright(x_m, y_m, 0.2), "metal")


def scene():
    """Fifteen posts of three classes in turns, ground below them, and a person."""
    classes = (BUILDING, THIN_STRUCTURE, GROUND)
    solids = [post(classes[n % 3], *place) for n, place in enumerate(PLACES_M)]
    person = box_actor(VRU, (0.4, 0.4, 1.6), [[6.7, 0.2, 2.1]] * 2, 0.8)
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


@pytest.fixture(scope="module")
def whole(truth):
    return occupied(truth, "voxels", 0.0)


def test_nothing_is_lost_to_no_damage(truth, whole):
    for kind in (*SHARES, *LENGTHS):
        assert (occupied(truth, kind, 99.0 if kind == "far" else 0.0) == whole).all()


def test_objects_are_lost_whole_but_for_the_ground(truth, whole):
    semantics, moving = truth.at(0, np.eye(4), GRID)
    assert (occupied(truth, "objects", 1.0) == (semantics == GROUND)).all()
    half = occupied(truth, "objects", 0.5)
    for x_m, y_m in PLACES_M:
        column = tuple(np.floor((np.array([x_m, y_m]) - GRID.lower_m[:2]) / 0.5).astype(int))
        left = half[column].sum() / whole[column].sum()
        assert left in (0.0, 1.0)
    assert 0 < half.sum() < whole.sum()
    assert moving.any()


@pytest.mark.parametrize(("name", "class_id"), [("thin_structure", THIN_STRUCTURE), ("vru", VRU)])
def test_a_class_is_lost_and_no_other(name, class_id, truth, whole):
    semantics, _ = truth.at(0, np.eye(4), GRID)
    lost = whole & ~occupied(truth, name, 1.0)
    assert (lost == (semantics == class_id)).all()


def test_shares_of_voxels_and_of_phantoms_and_all_that_is_near_or_far(truth, whole):
    left = occupied(truth, "voxels", 0.6).sum() / whole.sum()
    assert left == pytest.approx(0.4, abs=0.12)
    more = occupied(truth, "phantoms", 0.02)
    assert (more | whole == more).all()
    assert (more & ~whole).mean() == pytest.approx(0.02, abs=0.005)
    near, far = occupied(truth, "near", 6.0), occupied(truth, "far", 6.0)
    assert (near ^ far == whole).all()
    assert GRID.centers().norm(dim=-1).numpy()[near].min() >= 6.0


def test_ahead_moves_and_grown_thickens(truth, whole):
    assert (occupied(truth, "ahead", 1.0)[2:] == whole[:-2]).all()
    thick = occupied(truth, "grown", 0.5)
    assert (thick | whole == thick).all()
    assert 2 < thick.sum() / whole.sum() < 27


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
