"""The nine evaluated classes, the unknown label, and their colors (Sec. 5.1 of the paper)."""

from typing import Final

# sRGB, 0 to 255. The classes have the order of their labels; unknown is none of them. Who confuses
# red and green can tell any two apart: see tests/test_ontology.py.
COLORS: Final = {
    "building": (112, 128, 150),
    "ground": (188, 170, 146),
    "vegetation": (74, 148, 66),
    "thin_structure": (240, 196, 25),
    "large_vehicle": (142, 68, 173),
    "car": (41, 98, 255),
    "vru": (240, 40, 40),
    "general": (60, 215, 200),
    "free": (236, 242, 248),
    "unknown": (255, 255, 255),
}
CLASSES: Final = tuple(name for name in COLORS if name != "unknown")
NUM_CLASSES: Final = len(CLASSES)
BUILDING, GROUND, VEGETATION, THIN_STRUCTURE, LARGE_VEHICLE, CAR, VRU, GENERAL, FREE = range(9)
OCCUPIED: Final = tuple(range(FREE))

# No loss and no score ever counts a voxel with this label.
UNKNOWN: Final = 255
# In the ``class_*`` images of ``aux.npz``: a pixel whose ray hits nothing.
SKY: Final = 255

# A tied vote for a voxel goes to the rarer class. Fig. 5 C of the paper gives the order of the
# rare ones; the rest is ordered by how little room the class takes in a street.
_RARE = (VRU, CAR, THIN_STRUCTURE, LARGE_VEHICLE)
RAREST_FIRST: Final = (*_RARE, GENERAL, VEGETATION, BUILDING, GROUND)

ACTOR_TYPES: Final = {
    "car": CAR,
    "truck": LARGE_VEHICLE,
    "bus": LARGE_VEHICLE,
    "pedestrian": VRU,
    "bicycle": VRU,
    "motorcycle": VRU,
}
