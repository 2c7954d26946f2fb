"""SkyOcc: the network and its losses, as plain modules."""

from .attention import DeformableCrossAttention
from .backbone import ResNet
from .decoder import PillarDecoder
from .encoder import PillarEncoder
from .history import History
from .losses import OccupancyLoss, safety_weights
from .network import SkyOcc

__all__ = [
    "DeformableCrossAttention",
    "History",
    "OccupancyLoss",
    "PillarDecoder",
    "PillarEncoder",
    "ResNet",
    "SkyOcc",
    "safety_weights",
]
