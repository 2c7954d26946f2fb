"""Scores of an occupancy prediction: arithmetic in `functional`, thin metrics around it."""
# ruff: noqa: F401 (what others import from here)

from .breakdown import KARBreakdown
from .by_clip import ByClip
from .calibration import Calibration
from .count_metric import CountMetric
from .object_miss import ObjectMiss
from .occupancy import KARMeanIoU, OccupancyScores
from .occupied_calibration import OccupiedCalibration
from .plan_regret import PlanRegret
from .primitive_miss import PrimitiveMiss
from .ray_iou import CameraRayIoU, RayIoU
from .safety import SafetyScores
