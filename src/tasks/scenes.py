"""Frames of the data set as scenes: what the camera saw, the labels, what models make of it."""

from collections.abc import Callable, Mapping

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor
from torch.utils.data import default_collate

from ..data.batch import Batch
from ..geometry import VoxelGrid, camera_from_occ
from ..report.scene import VoxelScene
from ..report.view import Frustum
from .predictor import on_device

Network = Callable[[Batch], Tensor]
"""A module with a ``device``, which gives the logits of a batch that is there."""
Labels = UInt8[np.ndarray, "X Y Z"]


def scene_of(
    sample: Batch, grid: VoxelGrid, predictions: Mapping[str, Labels], remark: str = ""
) -> VoxelScene:
    """A sample of an `OccupancyDataset`, with what is predicted there, as by `labels_of`.

    ``remark`` follows the frame's name in the title.
    """
    roll_deg, pitch_deg = torch.rad2deg(sample["attitude_rad"]).tolist()
    title = f"{sample['clip']} frame {sample['frame']} · roll {roll_deg:+.0f}° "
    title += f"pitch {pitch_deg:+.0f}°{remark and ' · ' + remark}"
    return VoxelScene(
        title=title,
        grid=grid,
        image=sample["image"][-1].permute(1, 2, 0).numpy(),
        truth=sample["semantics"].numpy(),
        predictions=dict(predictions),
        frustum=camera_of(sample, sample["occ_from_body"][-1]),
    )


def camera_of(sample: Batch, occ_from_body: Tensor) -> Frustum:
    """The camera of a sample's current frame on a UAV with some attitude."""
    height, width = sample["image"].shape[-2:]
    chain = camera_from_occ(occ_from_body, sample["body_from_camera"])
    return Frustum(chain, sample["pix_from_camera"][-1], (width, height))


@torch.no_grad()
def labels_of(network: Network, sample: Batch) -> Labels:
    """What a network in evaluation mode predicts of a sample."""
    logits = network(on_device(default_collate([sample]), network.device))
    return logits.argmax(dim=1)[0].to(torch.uint8).cpu().numpy()
