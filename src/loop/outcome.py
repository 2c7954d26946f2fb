"""What came of one flight, as a row of ``flights.csv``."""

import math

import numpy as np

from ..data.rates import STEP_HZ as SCENE_HZ
from ..ontology import CLASSES, UNKNOWN
from ..sim.scene import SceneActor
from .airframe import POSITION, ROTATION, STEP_HZ, VELOCITY
from .flight import Flown
from .stage import Stage

# Slower than this the UAV, or what it met, counts as standing.
STANDING_MPS = 0.5

Row = dict[str, object]


def row_of(stage: Stage, flown: Flown, threshold: float) -> Row:
    """Describes a flight with the planner's ``threshold`` of occupied.

    ``clearance_m`` is from the body's center to the nearest surface, 2 m where all were farther.
    ``hit`` is the class of what was hit. ``believed_2s`` and so on are the highest probabilities of
    occupied that the map had within a metre of where the flight ended, so long before; of what
    moves, of where it was then. ``jerk2`` is the integral of the squared jerk over the length of
    the path, in m/s5 (FlightBench's).
    """
    collided = flown.outcome == "collided"
    nearest = flown.nearest
    speeds_mps = np.linalg.norm(flown.states[:, VELOCITY], axis=1)
    thrust_axis = flown.states[:, ROTATION.start + 8]
    velocity_mps = flown.states[:: STEP_HZ // SCENE_HZ, VELOCITY]
    jerk_mps3 = np.diff(velocity_mps, n=2, axis=0) * SCENE_HZ**2
    jerk2 = float((jerk_mps3**2).sum()) / SCENE_HZ / max(flown.path_m, 1.0)

    return {
        "outcome": flown.outcome,
        "time_s": round(flown.time_s, 3),
        "path_m": round(flown.path_m, 3),
        "clearance_m": round(nearest.distance_m, 4),
        "hit": CLASSES[nearest.class_id] if collided and nearest.class_id != UNKNOWN else "",
        "fault": _fault(stage, flown, threshold) if collided else "",
        "speed_mps": round(float(speeds_mps.mean()), 3),
        "tilt_deg": round(math.degrees(math.acos(min(1.0, float(thrust_axis.min())))), 2),
        "jerk2": round(jerk2, 4),
        "halts": flown.halts,
        **dict(zip(("believed_2s", "believed_1s", "believed_05s"), np.round(flown.believed, 4))),
    }


def _fault(stage: Stage, flown: Flown, threshold: float) -> str:
    """Returns the reason of a collision.

    ``ran_into_us``: something that moves met a UAV that stood, or came from outside its view.
    ``planned_into``: the map had called the place occupied, 0.5 to 2 s before. Else ``missed``.
    """
    for actor in stage.scene.actors:
        if actor.actor_id == flown.nearest.actor_id and _ran_into(actor, flown):
            return "ran_into_us"
    return "planned_into" if max(flown.believed) > threshold else "missed"


def _ran_into(actor: SceneActor, flown: Flown) -> bool:
    state = flown.states[-1]
    step = len(flown.states) * SCENE_HZ // STEP_HZ
    if np.linalg.norm(actor.velocity_mps[step]) < STANDING_MPS:
        return False
    if np.linalg.norm(state[VELOCITY]) < STANDING_MPS:
        return True
    away_m = (actor.position_m[step] - state[POSITION])[:2]
    ahead = state[ROTATION].reshape(3, 3)[:2, 0]
    # The camera sees 45 degrees to each side.
    return float(away_m @ ahead) < math.cos(math.pi / 4) * math.hypot(*away_m) * math.hypot(*ahead)
