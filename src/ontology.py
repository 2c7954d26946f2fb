"""The nine evaluated classes, the unknown label, and their colours (Sec. 5.1 of the paper)."""

from typing import Final

CLASSES: Final = (
    "building",
    "ground",
    "vegetation",
    "thin_structure",
    "large_vehicle",
    "car",
    "vru",
    "general",
    "free",
)
NUM_CLASSES: Final = len(CLASSES)
BUILDING, GROUND, VEGETATION, THIN_STRUCTURE, LARGE_VEHICLE, CAR, VRU, GENERAL, FREE = range(9)
UNKNOWN: Final = 255
"""No loss and no score ever counts a voxel with this label."""

SKY: Final = 255
"""In the ``class_*`` images of ``aux.npz``: a pixel whose ray hits nothing."""

OCCUPIED: Final = tuple(range(FREE))

RAREST_FIRST: Final = (
    VRU,
    CAR,
    THIN_STRUCTURE,
    LARGE_VEHICLE,
    GENERAL,
    VEGETATION,
    BUILDING,
    GROUND,
)
"""Who wins a tied vote for a voxel: the rarer class (Fig. 5 C of the paper gives the order of the
rare ones; the rest is ordered by how little room the class takes in a street)."""

ACTOR_TYPES: Final = {
    "car": CAR,
    "truck": LARGE_VEHICLE,
    "bus": LARGE_VEHICLE,
    "pedestrian": VRU,
    "bicycle": VRU,
    "motorcycle": VRU,
}

COLORS: Final = {
    "building": (112, 128, 150),
    "ground": (188, 170, 146),
    "vegetation": (74, 148, 66),
    "thin_structure": (240, 196, 25),
    "large_vehicle": (142, 68, 173),
    "car": (41, 98, 255),
    "vru": (230, 30, 60),
    "general": (0, 172, 172),
    "free": (236, 242, 248),
    "unknown": (255, 255, 255),
}
"""sRGB, 0 to 255."""
