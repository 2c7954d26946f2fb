"""Labels of the front image's pixels: the class that each sees and its depth, from the voxels."""

from typing import TypedDict

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64, UInt8
from torch import Tensor
from torch.utils.data import Dataset

from ..geometry import VoxelGrid, camera_from_occ, pixel_centers
from ..jit import njit
from ..ontology import FREE
from ..voxels import first_hit, rays_in_grid
from .batches import Key
from .dataset import OccupancyDataset


class ImageLabels(TypedDict):
    """An image and what its pixels see, on a raster ``stride`` times as coarse."""

    image: UInt8[Tensor, "3 H W"]
    # The class of the first occupied voxel on the ray of the pixel's center, or `FREE`.
    classes: Int64[Tensor, "h w"]
    # z-depth of that voxel's face; zero where none is met.
    depth_m: Float[Tensor, "h w"]


class ImageLabelDataset(Dataset):
    """The current frames of an `OccupancyDataset` with labels of their pixels.

    Voxels without a label count as empty, so what a pixel sees may lie behind one.
    """

    def __init__(self, frames: OccupancyDataset, grid: VoxelGrid, stride: int) -> None:
        self.frames, self.grid, self.stride = frames, grid, stride

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, key: int | Key) -> ImageLabels:
        sample = self.frames[key]
        chain = camera_from_occ(sample["occ_from_body"][-1], sample["body_from_camera"])
        image = sample["image"][-1]
        classes, depth_m = labels_of_pixels(
            sample["semantics"].numpy(),
            self.grid,
            chain,
            sample["pix_from_camera"][-1],
            (image.shape[-1], image.shape[-2]),
            self.stride,
        )
        return {"image": image, "classes": classes, "depth_m": depth_m}


def labels_of_pixels(
    semantics: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    camera_from_occ: Float[Tensor, "4 4"],
    pix_from_camera: Float[Tensor, "3 3"],
    size_pix: tuple[int, int],
    stride: int,
) -> tuple[Int64[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Class and z-depth in metres at the centers of squares of ``stride`` pixels.

    ``size_pix`` is the image's width and height.
    """
    width, height = (side // stride for side in size_pix)
    # Centers of the coarse squares, in pixels of the image.
    pix = stride * pixel_centers(width, height).flatten(0, 1)
    origin, directions = rays_in_grid(pix, camera_from_occ, pix_from_camera, grid)
    classes = np.full(len(pix), FREE, np.int64)
    depth_m = np.zeros(len(pix), np.float32)
    rays = origin.numpy(), directions.contiguous().numpy()
    _march(semantics, semantics < FREE, *rays, classes, depth_m)

    return (
        torch.from_numpy(classes).view(height, width),
        torch.from_numpy(depth_m).view(height, width),
    )


@njit(error_model="numpy")
def _march(
    semantics: UInt8[np.ndarray, "X Y Z"],
    occupied: Bool[np.ndarray, "X Y Z"],
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    classes: Int64[np.ndarray, "n"],
    depth_m: Float[np.ndarray, "n"],
) -> None:
    for n in range(len(directions)):
        cell, distance, axis = first_hit(occupied, origin, directions[n])
        if axis >= 0:
            classes[n] = semantics[cell]
            depth_m[n] = distance
