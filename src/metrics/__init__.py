"""Scores of an occupancy prediction: arithmetic in `functional`, thin metrics around it."""

from .breakdown import KARBreakdown
from .by_clip import ByClip
from .calibration import Calibration
from .kar import KARMeanIoU
from .occupancy import OccupancyScores
from .ray_iou import RayIoU
from .safety import SafetyScores
from .sensitivity import KARSensitivity

__all__ = [
    "ByClip",
    "Calibration",
    "KARBreakdown",
    "KARMeanIoU",
    "KARSensitivity",
    "OccupancyScores",
    "RayIoU",
    "SafetyScores",
]
