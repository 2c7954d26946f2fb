"""A town for tests: a flat yard with a wall, a wire, a shed and one corridor, and no traffic."""

import numpy as np

from src.ontology import BUILDING, THIN_STRUCTURE
from src.sim.assets import upright
from src.sim.layout import GroundPatch, Path, Town
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
