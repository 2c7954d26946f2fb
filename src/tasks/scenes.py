"""Frames of the dataset as scenes: the camera's image, the labels, and what models predict."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from lightning.fabric.utilities import move_data_to_device
from torch import Tensor
from torch.utils.data import default_collate

from ..data.batch import Batch
from ..data.clip import Clip
from ..data.datamodule import SkyShieldData
from ..geometry import VoxelGrid, camera_from_occ
from ..models.module import OccupancyModule
from ..report.qualitative import pick_frames, qualitative_sheet
from ..report.scene import VoxelScene
from ..report.view import Frustum

# A module with a ``device``, which gives the logits of a batch that is there.
Network = Callable[[Batch], Tensor]
Labels = UInt8[np.ndarray, "X Y Z"]


def scene_of(
    sample: Batch, grid: VoxelGrid, predictions: Mapping[str, Labels], remark: str = ""
) -> VoxelScene:
    """Returns a sample of an `OccupancyDataset` with predictions there, as those of `labels_of`.

    ``remark`` follows the frame's name in the title, in the place of its tilt.
    """
    roll_deg, pitch_deg = torch.rad2deg(sample["attitude_rad"]).tolist()
    tilt = f"roll {roll_deg:+.0f}° pitch {pitch_deg:+.0f}°"
    title = f"{sample['clip']} frame {sample['frame']} · {remark or tilt}"
    height, width = sample["image"].shape[-2:]
    chain = camera_from_occ(sample["occ_from_body"][-1], sample["body_from_camera"])

    return VoxelScene(
        title=title,
        grid=grid,
        image=sample["image"][-1].permute(1, 2, 0).numpy(),
        truth=sample["semantics"].numpy(),
        predictions=dict(predictions),
        frustum=Frustum(chain, sample["pix_from_camera"][-1], (width, height)),
    )


def tilt_rad(clip: Clip, frame: int) -> float:
    """Returns |roll| + |pitch| of a frame's true attitude."""
    return clip.frames.loc[frame, ["roll_rad", "pitch_rad"]].abs().sum()


@torch.no_grad()
def labels_of(network: Network, sample: Batch) -> Labels:
    """Returns the labels that a network, in evaluation mode, predicts for a sample."""
    logits = network(move_data_to_device(default_collate([sample]), network.device))
    return logits.argmax(dim=1)[0].to(torch.uint8).cpu().numpy()


def draw_sheet(
    module: OccupancyModule, data: SkyShieldData, part: str, path: Path, heading: str, frames: int
) -> None:
    """Draws the qualitative sheet of so many frames of a part of the split, chosen by
    `pick_frames`."""
    dataset = data.dataset(part)
    tilts = np.array([tilt_rad(data.clips[clip], frame) for clip, frame in dataset.samples])
    module.eval()

    samples = [dataset[index] for index in pick_frames(tilts, frames)]
    scenes = [
        scene_of(sample, data.grid, {"Prediction": labels_of(module, sample)}) for sample in samples
    ]
    qualitative_sheet(scenes, path, heading)
