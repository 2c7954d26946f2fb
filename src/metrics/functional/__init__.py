"""The arithmetic of the scores: pure functions of tensors, on any device."""
# ruff: noqa: F401 (what others import from here)

from .codes import Codes, Labels, Logits, Mask, Preds, Rays, Vector, Velocity, encode, labels_of
from .confusion import confusion_counts, is_compiled
from .iou import Confusion, geometric_iou, iou_compute, mean_iou, precision_compute, recall_compute
from .kar_mean_iou import kar_mean_iou
from .penalty import FIXED_POINT, Penalty, distance_shells, speeds
from .primitives import Swept, primitive_paths, swept, within
from .rays import camera_rays, first_met
