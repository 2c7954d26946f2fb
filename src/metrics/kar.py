"""KAR-mIoU, the paper's safety-aware score (Sec. 3.3, App. A.4)."""

from jaxtyping import Float
from torch import Tensor

from . import functional as F
from .confusion import PenalizedConfusion
from .tables import Scores, Tables


class KARMeanIoU(PenalizedConfusion):
    """Mean KAR-IoU of the occupied classes: IoU in which near errors weigh more.

    `functional.kar_mean_iou` is its definition, with the paper's equations. The score is the mean
    over the classes other than ``free_index``, in [0, 1]. Correct voxels are never rewarded for
    being near. A class with no TP, FP or FN in the dataset is left out of the mean; when none is
    left, the score is NaN. Unknown voxels are never counted.

    Args:
        grid: the voxels that the tensors cover, in metres in the occ frame.
        num_classes: class ids run from 0 to ``num_classes - 1``; 15 at most.
        free_index: the class of free space, whose own KAR-IoU `OccupancyScores` reports.
        ignore_index: the target label of unknown voxels.
        horizon_s: the time to collision beyond which an error weighs 1 (the paper's T_h).
        decay_per_s: how fast the penalty falls with that time (lambda).
        penalty_scale: the most that is added to an error's weight (gamma).
        min_speed_mps: a slower UAV is taken to fly at this speed (v_min).
        backend: how voxels are counted: ``numba`` (one compiled pass, CPU only), ``torch`` (plain
            operations, any device), or ``auto``, the faster one that runs there. All give the same
            bits.

    Raises `UserError`, a ``ValueError``, for parameters or batches that make no sense; see
    `update` for the shapes.

    >>> import torch
    >>> from src.geometry import VoxelGrid
    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([0, 0, 5, 8]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 0, 8, 8]).view(1, 4, 1, 1)    # the car 5 m ahead is missed
    >>> score = KARMeanIoU(grid)
    >>> score.update(preds, target, velocity=torch.tensor([[10.0, 0.0, 0.0]]))
    >>> score.compute()                                        # the building 1, the car 0
    tensor(0.5000)
    """

    def scores(self, tables: Tables) -> Scores:
        """Returns ``kar_miou`` of tables ``count`` and ``excess`` [*n, c, c]."""
        kar_iou = F.iou_compute(tables["count"], tables["excess"])
        return {"kar_miou": F.mean_iou(kar_iou, without=self.free_index)}

    def compute(self) -> Float[Tensor, ""]:
        """Returns the score of everything counted so far."""
        return super().compute()["kar_miou"]
