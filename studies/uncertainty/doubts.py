"""Which doubt of a network tells the objects that it misses from what is free.

    python -m studies.uncertainty.doubts ckpt_path=FILE [OVERRIDE...] [--split test] [--out FILE]

Of the voxels that are called free, some are occupied. Every doubt orders them: AUROC is how often a
missed one is doubted more than one that is truly free (0.5: by chance), and FPR95 the share of the
free ones that are doubted as well where 95 % of the missed ones are. The ground counts as free,
since nothing is missed there. Doubts that look past the class scores:

- the spread of two inputs: what the network says of the mirrored frame, turned back
  (`mutual information` of both, and their mean probability),
- the entropy of the depth that it gives the pixel in which a voxel lies,
- whether its own surfaces hide a voxel, or the camera never looks there (`src.knowledge`).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from src.data.batch import Batch, mirrored
from src.geometry import VoxelGrid, camera_from_occ, in_image, project
from src.knowledge import SEEN, knowledge
from src.metrics.safety import swept_tube
from src.models.checkpoint import Checkpoint
from src.models.network import SkyOcc
from src.ontology import FREE, GROUND
from src.parallax import RASTER
from src.results.files import write_table
from src.terminal import tracked
from studies.settings import composed_with_data, run
from studies.tables import print_table

OUT = Path(__file__).with_name("doubts.csv")
# Doubts are counted by the logarithm, from 1e-8 to 1.
LEVELS, SMALLEST = 4096, 1e-8
TUBE_S, TUBE_RADIUS_M = 2.0, 1.0
# Where nothing is missed.
NOTHING_MISSED = (FREE, GROUND)


class Counts:
    """How many voxels have each level of each doubt, by place, free ones and missed ones."""

    def __init__(self) -> None:
        self.tables: dict[tuple[str, str], Int64[Tensor, "levels 2"]] = {}

    def add(self, place: str, doubt: str, values: Tensor, missed: Bool[Tensor, "n"]) -> None:
        depth = values.double().clamp(SMALLEST, 1).log10() / np.log10(SMALLEST)
        level = ((1 - depth) * (LEVELS - 1)).round().long()
        found = torch.bincount(2 * level + missed, minlength=2 * LEVELS).view(LEVELS, 2)
        self.tables[place, doubt] = self.tables.get((place, doubt), 0) + found

    def rows(self) -> Iterator[dict[str, object]]:
        for (place, doubt), table in self.tables.items():
            free, missed = table.double().T
            rates = {"auroc": auroc(free, missed), "fpr95": fpr_at(free, missed, 0.95)}
            sizes = {"missed": int(missed.sum()), "free": int(free.sum())}
            yield {"place": place, "doubt": doubt, **rates, **sizes}


def auroc(free: Float[Tensor, "levels"], missed: Float[Tensor, "levels"]) -> float:
    """Returns how often a missed voxel has the higher level; equal ones count half."""
    below = free.cumsum(0) - free / 2
    return float((missed * below).sum() / (missed.sum() * free.sum()))


def fpr_at(free: Float[Tensor, "levels"], missed: Float[Tensor, "levels"], share: float) -> float:
    """Returns the share of free voxels at the levels that hold this share of the missed ones."""
    above = missed.flip(0).cumsum(0) / missed.sum()
    last = int((above < share - 1e-12).sum())
    return float(free.flip(0).cumsum(0)[last] / free.sum())


def doubts_of(network: SkyOcc, batch: Batch, grid: VoxelGrid) -> dict[str, Tensor]:
    """Returns the doubts [X, Y, Z] of a frame by name, and what it is called as ``labels``."""
    own = network.step(batch, network.history_of(batch))
    probability = own.logits.softmax(1)[0]
    turned = mirrored(batch)
    other = network(turned).softmax(1)[0].flip(-2)

    mean = (probability + other) / 2
    shared = _entropy(mean) - (_entropy(probability) + _entropy(other)) / 2
    labels = probability.argmax(0)
    doubts = {
        "labels": labels,
        "probability of occupied": 1 - probability[FREE],
        "entropy of the classes": _entropy(probability) / np.log(len(probability)),
        "mirrored: mean probability": 1 - mean[FREE],
        "mirrored: mutual information": shared / np.log(2),
    }
    if own.sight is not None:
        doubts["entropy of the depth"] = _depth_entropy(own.sight.depth[0], batch, grid)
    doubts["hidden or out of sight"] = _unseen((labels != FREE).numpy(), batch, grid)
    return doubts


def _entropy(probability: Float[Tensor, "c *n"]) -> Float[Tensor, "*n"]:
    return torch.special.entr(probability).sum(0)


def _camera_of(batch: Batch) -> tuple[Tensor, Tensor]:
    chain = camera_from_occ(batch["occ_from_body"][0, -1], batch["body_from_camera"][0])
    return chain, batch["pix_from_camera"][0, -1]


def _depth_entropy(
    depth: Float[Tensor, "bins h w"], batch: Batch, grid: VoxelGrid
) -> Float[Tensor, "X Y Z"]:
    """Returns the entropy of the pixel's depth, as a share of the largest; 1 outside the image."""
    entropy = _entropy(depth.softmax(0)) / np.log(len(depth))
    height, width = batch["image"].shape[-2:]
    pix, depth_m = project(grid.centers().view(-1, 3), *_camera_of(batch))
    inside = in_image(pix, depth_m, width, height)
    column, row = (pix[inside] / RASTER).long().unbind(-1)
    doubt = torch.ones(len(pix))
    doubt[inside] = entropy[row, column]
    return doubt.view(grid.shape)


def _unseen(occupied: np.ndarray, batch: Batch, grid: VoxelGrid) -> Float[Tensor, "X Y Z"]:
    height, width = batch["image"].shape[-2:]
    told = knowledge(occupied, *_camera_of(batch), (width, height), grid)
    return torch.from_numpy(told != SEEN).float()


def places_of(batch: Batch, grid: VoxelGrid) -> dict[str, Bool[Tensor, "X Y Z"]]:
    """Returns where is counted: every labelled voxel, and those of the tube ahead."""
    known = batch["semantics"][0] <= FREE
    box, inside = swept_tube(grid, batch["velocity_mps"][0], TUBE_S, TUBE_RADIUS_M)
    tube = torch.zeros_like(known)
    tube[box] = inside
    return {"everywhere": known, "tube": known & tube}


@torch.no_grad()
def main(*overrides: str, split: str = "test", out: Path = OUT) -> None:
    cfg, data = composed_with_data([*overrides, "data.batch_size=1"])
    network, counts = Checkpoint.read(Path(cfg.ckpt_path)).network().eval(), Counts()
    for batch in tracked(data.in_order(split), "doubting"):
        doubts = doubts_of(network, batch, data.grid)
        called_free = doubts.pop("labels") == FREE
        occupied = ~torch.isin(batch["semantics"][0], torch.tensor(NOTHING_MISSED))
        for place, where in places_of(batch, data.grid).items():
            chosen = where & called_free
            for name, doubt in doubts.items():
                counts.add(place, name, doubt[chosen], occupied[chosen])

    table = pd.DataFrame(counts.rows())
    write_table(table.round(4), out)
    rows = [
        [row["place"], row["doubt"], f"{row['auroc']:.3f}", f"{row['fpr95']:.1%}", row["missed"]]
        for row in table.to_dict("records")
    ]
    columns = ("place", "doubt", "AUROC", "FPR95", "missed voxels")
    print_table(
        "What tells missed objects from free space", columns, [[*map(str, r)] for r in rows]
    )


if __name__ == "__main__":
    run(main)
