"""Scores of an occupancy prediction; definitions in `functional`, state in `confusion`."""

from .kar import KARMeanIoU
from .occupancy import OccupancyScores

__all__ = ["KARMeanIoU", "OccupancyScores"]
