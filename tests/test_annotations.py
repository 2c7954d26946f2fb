"""The tests check every annotation: a wrong shape or dtype raises where it enters."""

import pytest
import torch
from jaxtyping import TypeCheckError

from src.data.batch import ego_motion
from src.geometry import VoxelGrid, project
from src.metrics.functional import kar_mean_iou
from src.models.losses import lovasz

LABELS = torch.zeros(1, 4, 1, 1, dtype=torch.uint8)
GRID = VoxelGrid((0, -1, -1), (8, 1, 1), (4, 1, 1))


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (project, (torch.zeros(5, 2), torch.eye(4), torch.eye(3))),
        (project, (torch.zeros(2, 5, 3), torch.eye(4).expand(3, 4, 4), torch.eye(3))),
        (lovasz, (torch.zeros(9, 5), torch.zeros(4, dtype=torch.int64))),
        (kar_mean_iou, (LABELS, LABELS.bool(), torch.ones(1), GRID)),
        (ego_motion, (torch.eye(4)[None], torch.zeros(1, 3))),
    ],
)
def test_a_wrong_shape_or_dtype_raises(function, arguments):
    with pytest.raises(TypeCheckError, match=f"parameters of {function.__module__}"):
        function(*arguments)
