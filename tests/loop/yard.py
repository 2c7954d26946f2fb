"""A town for tests: a flat yard with a wall, a wire, a shed and one corridor, and no traffic."""

import numpy as np

from src.ontology import BUILDING, CLASSES, THIN_STRUCTURE
from src.sim.assets import upright
from src.sim.layout import GroundPatch, Path, Town
from src.sim.scene import SceneActor, parts_of
from src.sim.solid import Solid
from src.sim.textures import CABLE

WALL_X_M, WIRE_X_M = 30.0, 40.0
WALL = Solid("box", BUILDING, (1.0, 6.0, 8.0), upright(WALL_X_M, 0.0, 4.0), "concrete")
# Far from any way along x, and near enough to be known there.
SHED = Solid("box", BUILDING, (2.0, 2.0, 4.0), upright(-42.0, -42.0, 2.0), "concrete")
WIRE = Solid("box", THIN_STRUCTURE, (0.03, 40.0, 0.03), upright(WIRE_X_M, 0.0, 6.0), CABLE)


def build(_rng: np.random.Generator) -> Town:
    return Town(
        name="yard",
        terrain=lambda x, y: 0.0 * (x + y),
        solids=(WALL, WIRE, SHED),
        ground=(GroundPatch((0.0, 0.0), 0.0, 300.0, 100.0, 0.0, "grass"),),
        lanes=(),
        walks=(),
        corridors=(Path(np.array([[-100.0, -9.0], [100.0, -9.0]]), 3.0, 6.0, ()),),
    )


def box_actor(class_id, size_m, position_m, middle_m, velocity_mps=(0.0, 0.0, 0.0)) -> SceneActor:
    """A box that is at a place at each step, and whose middle is so far above that."""
    box = Solid("box", class_id, size_m, upright(0.0, 0.0, middle_m), "metal")
    position_m = np.array(position_m)
    velocity_mps = np.tile(velocity_mps, (len(position_m), 1))
    yaw_rad = np.zeros(len(position_m))
    return SceneActor(
        1, CLASSES[class_id], class_id, size_m, parts_of([box]), position_m, yaw_rad, velocity_mps
    )
