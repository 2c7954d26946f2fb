"""Scores a trained model and the two anchors on the test split, and draws what it sees."""

import dataclasses
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import lightning
import numpy as np
import torch
from hydra.utils import instantiate
from jaxtyping import UInt8
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from torch import Tensor
from torch.utils.data import default_collate
from torchmetrics import Metric

from ..data.datamodule import SkyShieldData
from ..geometry import camera_from_occ
from ..models.module import OccupancyModule
from ..models.prior import VoxelPrior
from ..ontology import FREE
from ..provenance import git_commit
from ..report.curves import draw_curves
from ..report.qualitative import Example, pick_frames, qualitative_sheet
from ..report.results import print_results, read_results, write_results
from ..report.view import Frustum
from ..run_folder import RunFolder

SHOWN_FRAMES = 5


def evaluate(
    cfg: DictConfig,
    folder: RunFolder,
    trainer: lightning.Trainer,
    module: OccupancyModule,
    data: SkyShieldData,
    prior: VoxelPrior,
) -> None:
    """Writes ``results.csv`` and the figures, and prints the table.

    The results come last: a folder with ``results.csv`` is complete.
    """
    facts = _facts(cfg, folder, data)
    parameters = sum(p.numel() for p in module.network.parameters())
    start_s = time.perf_counter()
    trainer.test(module, datamodule=data, verbose=False)
    seconds = time.perf_counter() - start_s
    rows = _rows(facts, cfg.name, module.test_scores, seconds, parameters)
    anchors = {"all_free": torch.full_like(prior.labels(), FREE), "voxel_prior": prior.labels()}
    for name, prediction in anchors.items():
        start_s = time.perf_counter()
        scored = anchor_scores(prediction, data, module.test_parts, instantiate(cfg.metric))
        rows += _rows(facts, name, scored, time.perf_counter() - start_s, parameters=0)
    draw_sheet(module, data, folder.figures / "qualitative.png", f"{cfg.name}, {cfg.scale_name}")
    if folder.metrics.is_file():
        draw_curves(folder.metrics, folder.figures / "curves.png")
    write_results(folder.results, sorted(rows, key=lambda row: row["split"]))
    print_results(read_results(folder.results))
    Console().print(f"{folder.results} and {folder.figures}", highlight=False, soft_wrap=True)


def anchor_scores(
    prediction: UInt8[Tensor, "X Y Z"],
    data: SkyShieldData,
    parts: dict[str, Callable[[str], bool]],
    make_scores: Callable[..., Metric],
) -> dict[str, Metric]:
    """Scores of one fixed prediction on every part of the test split."""
    scores = {part: make_scores(data.grid) for part in parts}
    frames = zip(data.split["test"], data.labels("test"))
    for (clip, _), (semantics, velocity) in frames:
        for part, belongs in parts.items():
            if belongs(clip):
                scores[part].update(prediction[None], semantics[None], velocity[None].float())
    return scores


def _facts(cfg: DictConfig, folder: RunFolder, data: SkyShieldData) -> dict:
    """What every row of ``results.csv`` shares."""
    return {
        "scale": cfg.scale_name,
        "seed": cfg.seed,
        "protocol": protocol_of(cfg, data),
        "code_version": folder.version,
        "git_commit": git_commit(),
        "dataset": data.root.name,
    }


def _rows(
    facts: dict, experiment: str, parts: Mapping[str, Metric], seconds: float, parameters: int
) -> list[dict]:
    """A row of ``results.csv`` for each part that has a frame; the seconds are of all together."""
    return [
        {
            **facts,
            "experiment": experiment,
            "split": part,
            **{name: float(value) for name, value in scores.compute().items()},
            "seconds": round(seconds, 1),
            "parameters": parameters,
        }
        for part, scores in parts.items()
        if scores.update_called
    ]


def protocol_of(cfg: DictConfig, data: SkyShieldData) -> dict:
    """What was counted and how: without it a score of this field means little."""
    metric = OmegaConf.to_container(cfg.metric, resolve=True)
    return {
        "mask": "every supervised voxel",
        "miou": "9 classes, free in",
        "miou_occupied": "8 classes, free out",
        "kar_miou": "8 classes, free out",
        "absent_class": "left out of the mean",
        "accumulation": "counts over the data set",
        "grid": dataclasses.asdict(data.grid),
        **{key: value for key, value in metric.items() if not key.startswith("_")},
    }


@torch.no_grad()
def draw_sheet(module: OccupancyModule, data: SkyShieldData, path: Path, heading: str) -> None:
    """The qualitative sheet of a few test frames, chosen by `pick_frames`."""
    dataset = data.dataset("test")
    tilt_rad = np.array([_tilt_rad(data, *sample) for sample in dataset.samples])
    chosen = pick_frames(tilt_rad, SHOWN_FRAMES)
    module.eval()
    qualitative_sheet(
        list(_examples(module, (dataset[index] for index in chosen))), data.grid, path, heading
    )


def _tilt_rad(data: SkyShieldData, clip: str, frame: int) -> float:
    row = data.clips[clip].frames.loc[frame]
    return abs(row["roll_rad"]) + abs(row["pitch_rad"])


def _examples(module: OccupancyModule, samples: Iterable[dict]) -> Iterable[Example]:
    for sample in samples:
        batch = module.transfer_batch_to_device(default_collate([sample]), module.device, 0)
        roll_deg, pitch_deg = torch.rad2deg(sample["attitude_rad"]).tolist()
        height, width = sample["image"].shape[-2:]
        yield Example(
            image=sample["image"][-1].permute(1, 2, 0).numpy(),
            truth=sample["semantics"].numpy(),
            prediction=module(batch).argmax(dim=1)[0].to(torch.uint8).cpu().numpy(),
            title=f"{sample['clip']} frame {sample['frame']} · roll {roll_deg:+.0f}° "
            f"pitch {pitch_deg:+.0f}°",
            frustum=Frustum(
                camera_from_occ(sample["occ_from_body"][-1], sample["body_from_camera"]),
                sample["pix_from_camera"][-1],
                (width, height),
            ),
        )
