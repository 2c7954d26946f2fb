"""The same predictions under other protocols: how far the choice alone moves the number."""

import pandas as pd

from ..metrics import functional as F
from .counts import Counts


def protocol_table(counts: Counts) -> pd.DataFrame:
    """Returns a row for each protocol: what it averages, and the score in [0, 1].

    Papers of this field report each of these rows. All are computed from the counts of one pass.
    """
    suite, rows = counts.suite(), counts.rows()
    free = counts.protocol.metric["free_index"]
    count = counts.tables["occupancy"]["count"][rows].cpu()
    iou, by_clip = F.iou_compute(count.sum(0)), F.iou_compute(count)
    visible = F.iou_compute(counts.tables["breakdown"]["count"][rows][:, 1].cpu().sum((0, 1)))
    parts = counts.scores("breakdown", rows)

    # Classes without a voxel are NaN, and left out of a mean; some papers count them as 0.
    scores = {
        "mIoU, free space averaged in": F.mean_iou(iou),
        "mIoU of occupied classes": F.mean_iou(iou, without=free),
        "the same, an absent class counts as 0": F.mean_iou(iou.nan_to_num(0), without=free),
        "the same, mean over clips of each clip's score": F.mean_iou(by_clip, free).nanmean(),
        "the same, visible voxels": F.mean_iou(visible, without=free),
        "mIoU, free space in, visible voxels": F.mean_iou(visible),
        "KAR-mIoU": parts["all/kar_miou"],
        "KAR-mIoU, visible voxels": parts["visible/kar_miou"],
        "geometric IoU, occupied against free": F.geometric_iou(count.sum(0), free),
    }
    for edge_m in suite.metric("breakdown").distance_edges_m:
        score = parts[f"all/within_{edge_m:g}m/miou_occupied"]
        scores[f"mIoU of occupied classes within {edge_m:g} m"] = score
    if "rays" in counts.tables:  # their cameras are known
        scores["RayIoU, mean of its thresholds"] = counts.scores("rays", rows)["ray_iou"]

    values = [(name, float(score)) for name, score in scores.items()]
    return pd.DataFrame(values, columns=["protocol", "score"])
