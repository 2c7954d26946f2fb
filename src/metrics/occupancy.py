"""Every score of an occupancy prediction that a result table shows."""

from . import functional as F
from .confusion import PenalizedConfusion
from .tables import Scores, Tables


class OccupancyScores(PenalizedConfusion):
    """IoU and KAR-IoU of every class, and their means, from one pass; arguments as `KARMeanIoU`.

    `compute` gives a dict of scalars in [0, 1]:

    - ``miou``: mean IoU over all classes, free space included (the paper's mIoU),
    - ``miou_occupied``: mean IoU without free space, which is ``kar_miou`` at ``penalty_scale=0``,
    - ``kar_miou``: mean KAR-IoU without free space (the paper's KAR-mIoU),
    - ``iou/<class>`` and ``kar_iou/<class>``: per class, free space included. The names are those
      of the ontology, or the class ids when ``num_classes`` is another.

    A class with no TP, FP or FN is NaN and left out of the means.

    >>> import torch
    >>> from src.geometry import VoxelGrid
    >>> grid = VoxelGrid(lower_m=(0, -1, -1), upper_m=(8, 1, 1), shape=(4, 1, 1))
    >>> target = torch.tensor([0, 0, 8, 255]).view(1, 4, 1, 1)
    >>> preds = torch.tensor([0, 8, 8, 0]).view(1, 4, 1, 1)    # the building 3 m ahead is missed
    >>> scores = OccupancyScores(grid)
    >>> scores.update(preds, target, velocity=torch.tensor([10.0]))
    >>> for name, value in scores.compute().items():
    ...     if not value.isnan():
    ...         print(f"{name:16} {value:.3f}")
    miou             0.500
    miou_occupied    0.500
    kar_miou         0.269
    iou/building     0.500
    iou/free         0.500
    kar_iou/building 0.269
    kar_iou/free     0.269
    """

    def scores(self, tables: Tables) -> Scores:
        """Returns the scores of tables ``count`` and ``excess`` [*n, c, c]."""
        iou = F.iou_compute(tables["count"])
        kar_iou = F.iou_compute(tables["count"], tables["excess"])

        scores = {
            "miou": F.mean_iou(iou),
            "miou_occupied": F.mean_iou(iou, without=self.free_index),
            "kar_miou": F.mean_iou(kar_iou, without=self.free_index),
        }
        scores |= {f"iou/{name}": iou[..., n] for n, name in enumerate(self.class_names)}
        scores |= {f"kar_iou/{name}": kar_iou[..., n] for n, name in enumerate(self.class_names)}
        return scores
