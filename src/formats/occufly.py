"""OccuFly's files: as SemanticKITTI's, a byte a voxel, along the camera's axes."""

from typing import ClassVar

import numpy as np

from ..ontology import UNKNOWN
from .label_format import Shape
from .semantickitti import SemanticKitti


class OccuFly(SemanticKitti):
    """``<scene>/<altitude>/ground_truth/<frame>/<frame>.label``, uint8, and its two masks.

    Their axes are right, down and forward, so that their last one is our x. Their cameras look
    down; our grid stays level, and only its axes are renamed. Predictions lie in ``predictions``
    instead of ``ground_truth``.
    """

    name = "occufly"
    pattern = "<scene>/<altitude>/ground_truth/<frame>/<frame>.label (predictions: predictions/...)"
    ids: ClassVar = {
        **{"building": 16, "ground": 1, "vegetation": 8, "thin_structure": 22},
        **{"large_vehicle": 36, "car": 13, "vru": 11, "general": 9, "free": 0},
        "unknown": UNKNOWN,
    }
    dtype = np.dtype(np.uint8)
    roles = ("ground_truth", "predictions")

    def scene_of(self, clip: str, number: int) -> str:
        return clip

    def place(self, scene: str, token: str, predicted: bool) -> str:
        return f"{scene}/{self.roles[predicted]}/{token}/{token}.label"

    def to_theirs(self, array: np.ndarray) -> np.ndarray:
        return array[:, ::-1, ::-1].transpose(1, 2, 0)

    def from_theirs(self, flat: np.ndarray, shape: Shape) -> np.ndarray:
        x, y, z = shape
        return flat.reshape(y, z, x).transpose(2, 0, 1)[:, ::-1, ::-1]
