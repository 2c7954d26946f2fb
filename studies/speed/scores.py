"""The cost of the scores: one frame, one thread, all in one run, each beside the others.

    python -m studies.speed.scores DATASET

``DATASET`` is the folder of any finished dataset; its labels are the target, and the labels of a
later frame stand for the prediction. Prints the milliseconds of an update, the ratio to
torchmetrics' `MulticlassJaccardIndex` at its defaults, and the memory that an update takes beyond
its inputs. The measures take turns, so that whatever else the machine does meets all of them.
"""

from collections.abc import Callable
from pathlib import Path

import torch
from torchmetrics.classification import MulticlassJaccardIndex

from src import metrics
from src.data.truth import SkyShieldTruth
from src.metrics.functional import camera_rays
from src.ontology import FREE, NUM_CLASSES, UNKNOWN
from studies.sensitivity.metric import KARSensitivity
from studies.settings import run
from studies.speed.timing import print_costs

ROUNDS = 15
RAYS = (100, 56)


def measures(dataset: Path) -> tuple[dict[str, Callable[[], object]], str]:
    """Returns the measures by name, and the name of the frame."""
    source = SkyShieldTruth(dataset)
    clip, frame = source.samples[0]
    truth = source.truth(clip, frame)
    later = source.truth(clip, source.samples[5][1])["semantics"]
    target, velocity, visible = (truth[key] for key in ("semantics", "velocity_mps", "visible"))
    # A prediction has no unknown voxels.
    preds = torch.where(later == UNKNOWN, FREE, later).to(torch.uint8)
    ids = preds.long()
    logits = torch.randn(1, NUM_CLASSES, *source.grid.shape, generator=torch.Generator())
    logits.scatter_(1, ids[:, None], 6.0)
    rays = camera_rays(*(truth[key] for key in ("camera_from_occ", "pix_from_camera", "size_pix")))

    grid = source.grid
    jaccard = MulticlassJaccardIndex(NUM_CLASSES, ignore_index=UNKNOWN)
    plain, compiled = (metrics.OccupancyScores(grid, backend=name) for name in ("torch", "numba"))
    breakdown, safety = metrics.KARBreakdown(grid), metrics.SafetyScores(grid)
    primitives, plans = metrics.PrimitiveMiss(grid), metrics.PlanRegret(grid)
    objects = metrics.ObjectMiss(grid)
    calibration = metrics.Calibration(grid)
    ray_iou, sensitivity = metrics.RayIoU(grid), KARSensitivity(grid)
    subject = f"{'x'.join(map(str, grid.shape))} voxels, {clip} frame {frame} of {source.name}"
    return {
        "MulticlassJaccardIndex (torchmetrics)": lambda: jaccard.update(ids, target),
        "OccupancyScores, plain torch": lambda: plain.update(preds, target, velocity),
        "OccupancyScores, numba (default on CPU)": lambda: compiled.update(preds, target, velocity),
        "MulticlassJaccardIndex, logits": lambda: jaccard.update(logits, target),
        "argmax of the logits": lambda: logits.argmax(dim=1),
        "OccupancyScores, logits": lambda: compiled.update(logits, target, velocity),
        "KARBreakdown": lambda: breakdown.update(preds, target, velocity, visible=visible),
        "SafetyScores": lambda: safety.update(preds, target, velocity),
        "PrimitiveMiss, logits": lambda: primitives.update(preds, target, velocity, logits=logits),
        "PlanRegret": lambda: plans.update(preds, target, velocity),
        "ObjectMiss": lambda: objects.update(preds, target, velocity),
        f"RayIoU, {RAYS[0]}x{RAYS[1]} rays": lambda: ray_iou.update(preds, target, *rays),
        "Calibration, logits": lambda: calibration.update(logits, target, velocity),
        "KARSensitivity, 81 settings": lambda: sensitivity.update(preds, target, velocity),
    }, subject


def main(dataset: Path) -> None:
    torch.set_num_threads(1)
    todo, subject = measures(dataset)
    print_costs(f"an update with {subject}", todo, ROUNDS)


if __name__ == "__main__":
    run(main)
