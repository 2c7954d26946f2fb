"""Labels in the formats of other tools: writers, and readers of what can be scored."""

from .occ3d import Occ3D
from .occufly import OccuFly
from .semantickitti import SemanticKitti
from .tartanground import TartanGround

WRITTEN_FORMATS = {each.name: each() for each in (Occ3D, SemanticKitti, OccuFly)}
LABEL_FORMATS = WRITTEN_FORMATS | {TartanGround.name: TartanGround()}
