"""How far off the depth of the pixels is, by class, where there is texture to compare.

    python -m studies.motion.depth runs/small/skyocc/seed0 [FOLDER ...] [--split val] [--out FILE]

Reads the best checkpoint of each run, and the frames that it was trained beside. Writes a row for
each run and class: pixels nearer than 64 m, and the median of their relative error, for all of
them and for those whose window of 7x7 pixels has a standard deviation of 2 % of grey or more.
"""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import torch
import torch.nn.functional as F
from jaxtyping import Bool
from omegaconf import OmegaConf
from torch import Tensor

from src.data.batch import Batch
from src.models.checkpoint import Checkpoint
from src.ontology import CLASSES, FREE
from src.parallax import FAR_M, LUMA, RASTER
from src.results.files import write_table
from src.run_folder import BEST, CONFIG
from src.tasks.dataset import finished_dataset
from src.tasks.session import data_of
from src.terminal import tracked
from studies.settings import run
from studies.tables import print_table

TEXTURE, WINDOW = 0.02, 7
OUT = Path(__file__).with_name("depth.csv")


def textured(batch: Batch) -> Bool[Tensor, "b h w"]:
    """Marks the places of the pixels' labels whose window in the current image is not smooth."""
    grey = torch.tensordot(batch["image"][:, -1].float() / 255, torch.tensor(LUMA), ([1], [0]))
    mean, mean_square = (
        F.avg_pool2d(each[:, None], WINDOW, 1, WINDOW // 2, count_include_pad=False)[:, 0]
        for each in (grey, grey.square())
    )
    center = slice(RASTER // 2, None, RASTER)
    variance = (mean_square - mean.square())[:, center, center]
    return variance >= TEXTURE**2


def frames_of(folder: Path, split: str) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Yields class, relative error and texture of the pixels of a batch that see something."""
    checkpoint = Checkpoint.read(folder / BEST)
    cfg = OmegaConf.load(folder / CONFIG)
    network, data = checkpoint.network(), data_of(cfg, finished_dataset(cfg))
    for batch in tracked(data.in_order(split, pixels=True), f"looking with {folder}"):
        with torch.no_grad():
            sight = network.step(batch, network.history_of(batch)).sight
        depth_m = batch["pixel_depth_m"]
        near = depth_m < FAR_M
        error = (sight.depth_m() / depth_m - 1).abs()
        yield batch["pixel_class"][near], error[near], textured(batch)[near]


def rows_of(folder: Path, split: str) -> Iterator[dict[str, object]]:
    class_id, error, has_texture = map(torch.cat, zip(*frames_of(folder, split)))
    for number, name in enumerate((*CLASSES[:FREE], "all")):
        of_class = (class_id == number) | (number == FREE)
        kinds = {"": of_class, "_textured": of_class & has_texture}
        medians = {f"median_percent{k}": 100 * error[m].median().item() for k, m in kinds.items()}
        pixels = {f"pixels{kind}": int(mask.sum()) for kind, mask in kinds.items()}
        named = {"run": "/".join(folder.parts[-3:]), "split": split, "class": name}
        yield {**named, **pixels, **medians}


def main(*folders: Path, split: str = "test", out: Path = OUT) -> None:
    table = pd.DataFrame([row for folder in folders for row in rows_of(folder, split)])
    write_table(table.round(2), out)
    means = table.groupby("class", sort=False).mean(numeric_only=True).round(1)
    rows = means.reset_index().map(str).to_numpy()
    print_table("median relative error of the depth, %", ("class", *means), rows)


if __name__ == "__main__":
    run(main)
