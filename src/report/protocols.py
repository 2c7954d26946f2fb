"""The same predictions under other protocols: how far the choice alone moves the number."""

import pandas as pd
import torch

from ..metrics import functional as F
from ..metrics.tally import Tally


def protocol_table(tally: Tally) -> pd.DataFrame:
    """A row for each protocol: what it averages, and the score in [0, 1].

    Every row is one that papers of this field report. They are computed from the tally of one pass.
    """
    suite = tally.suite()
    free = tally.protocol.metric["free_index"]
    clips = tally.rows()
    tables = {
        metric: {name: table[clips].cpu() for name, table in of_metric.items()}
        for metric, of_metric in tally.tables.items()
    }
    count = tables["occupancy"]["count"]
    iou = F.iou_compute(count.sum(0))
    seen = tables["breakdown"]["count"][:, 1].sum((0, 1))
    parts = suite.metric("breakdown").scores(
        {name: table.sum(0) for name, table in tables["breakdown"].items()}
    )
    by_clip = F.mean_iou(F.iou_compute(count), without=free)
    rows = {
        "mIoU, free space averaged in": F.mean_iou(iou),
        "mIoU of occupied classes": F.mean_iou(iou, without=free),
        "the same, an absent class counts as 0": F.mean_iou(iou.nan_to_num(0), without=free),
        "the same, mean over clips of each clip's score": by_clip.nanmean(),
        "the same, visible voxels": F.mean_iou(F.iou_compute(seen), without=free),
        "mIoU, free space in, visible voxels": F.mean_iou(F.iou_compute(seen)),
        "KAR-mIoU": parts["all/kar_miou"],
        "KAR-mIoU, visible voxels": parts["visible/kar_miou"],
        "geometric IoU, occupied against free": F.geometric_iou(count.sum(0), free),
    }
    for edge_m in suite.metric("breakdown").distance_edges_m:
        name = f"all/within_{edge_m:g}m/miou_occupied"
        rows[f"mIoU of occupied classes within {edge_m:g} m"] = parts[name]
    for name in ("rays", "sensitivity"):
        if name in tables:
            summed = {key: table.sum(0) for key, table in tables[name].items()}
            rows |= _EXTRA[name](suite.metric(name).scores(summed))
    return pd.DataFrame(
        [(name, float(value)) for name, value in rows.items()], columns=["protocol", "score"]
    )


_EXTRA = {
    "rays": lambda scores: {"RayIoU, mean of its thresholds": scores["ray_iou"]},
    "sensitivity": lambda scores: {
        "KAR-mIoU, the lowest of its parameter grid": torch.stack([*scores.values()]).min(),
        "KAR-mIoU, the highest of its parameter grid": torch.stack([*scores.values()]).max(),
    },
}
