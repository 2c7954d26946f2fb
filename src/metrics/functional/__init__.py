"""The arithmetic of the scores: pure functions of tensors, on any device."""

from .codes import MAX_CLASSES, bad_id, check_classes, check_shapes, encode, labels_of, target_rule
from .iou import geometric_iou, iou_compute, mean_iou, precision_compute, recall_compute
from .penalty import FIXED_POINT, Penalty, distance_shells, speeds, ttc_penalty
from .rays import camera_rays, first_met
from .tables import BACKENDS, Classes, Space, compiled, confusion_tables
from .tube import grown, swept_tube

__all__ = [
    "BACKENDS",
    "FIXED_POINT",
    "MAX_CLASSES",
    "Classes",
    "Penalty",
    "Space",
    "bad_id",
    "camera_rays",
    "check_classes",
    "check_shapes",
    "compiled",
    "confusion_tables",
    "distance_shells",
    "encode",
    "first_met",
    "geometric_iou",
    "grown",
    "iou_compute",
    "labels_of",
    "mean_iou",
    "precision_compute",
    "recall_compute",
    "speeds",
    "swept_tube",
    "target_rule",
    "ttc_penalty",
]
