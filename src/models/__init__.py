"""SkyOcc: the network and its losses, as plain modules."""
# ruff: noqa: F401 (what others import from here)

from .attention import DeformableCrossAttention
from .backbone import ResNet
from .bilinear_lift import BilinearLift
from .decoder import PillarDecoder
from .encoder import PillarEncoder
from .history import History
from .lift_splat import LiftSplat
from .losses import OccupancyLoss, safety_weights
from .network import SkyOcc
