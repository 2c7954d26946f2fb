"""The paper's own numbers of its dataset, to be set beside those of a generated one.

What only the card shows of them stands in its template, `card.md.j2`.
"""

from typing import Final

FRAMES: Final = 36_000
MEAN_HEIGHT_M: Final = 7.18

# Shares of "voxels" (Fig. 5 C); the paper does not say of which.
CLASS_SHARES: Final = {"free": 0.8278, "thin_structure": 0.0026, "car": 0.00071, "vru": 0.00016}

# Instances in the front image over all `FRAMES` (Fig. 5 D).
INSTANCES: Final = {
    "car": 74_530,
    "truck": 25_319,
    "bus": 23_201,
    "pedestrian": 31_322,
    "bicycle": 31_646,
    "motorcycle": 32_262,
}
