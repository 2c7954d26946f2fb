"""The paper's own numbers of its dataset, to be set beside those of a generated one."""

from typing import Final, NamedTuple

FRAMES: Final = 36_000

MEAN_HEIGHT_M: Final = 7.18
SHARE_BELOW_11_M: Final = 0.861
MAX_HEIGHT_M: Final = 20.0

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

# Table of App. B; the counts are those of Table 1.
STATISTICS: Final = {
    "Simulator": "CARLA",
    "Scenes": "8",
    "Weather conditions": "10",
    "Clips per scene": "15",
    "Clip duration": "12 s",
    "Capture frequency": "25 Hz",
    "Total samples": "36,000",
    "Train / Val / Test": "29,000 / 3,200 / 3,800",
    "Altitude range": "< 20 m",
    "Learning input": "monocular front-view RGB",
    "Annotation signals": "dual LiDAR + simulator semantics",
}


class Benchmark(NamedTuple):
    """A row of the paper's Table 1: four properties, the scene diversity, and the frames."""

    name: str
    uav_view: bool
    boxes_3d: bool
    occupancy: bool
    dynamic_camera: bool
    diversity: int
    train: int
    val: int
    test: int


BENCHMARKS: Final = (
    Benchmark("UAVDT", True, False, False, False, 1, 24_143, 0, 53_676),
    Benchmark("VisDrone", True, False, False, False, 3, 6_471, 548, 1_610),
    Benchmark("UAV3D", True, True, False, True, 2, 14_000, 3_000, 3_000),
    Benchmark("KITTI", False, True, False, False, 1, 7_481, 0, 7_518),
    Benchmark("nuScenes", False, True, False, False, 6, 28_130, 6_019, 6_008),
    Benchmark("SkyShield (the paper's)", True, True, True, True, 10, 29_000, 3_200, 3_800),
)
