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
        image, semantics = sample["image"][-1], sample["semantics"].numpy()
        chain = camera_from_occ(sample["occ_from_body"][-1], sample["body_from_camera"])
        lens, size_pix = sample["pix_from_camera"][-1], (image.shape[-1], image.shape[-2])

        seen = labels_of_pixels(semantics, self.grid, chain, lens, size_pix, self.stride)
        return {"image": image, "classes": seen[0], "depth_m": seen[1]}


def labels_of_pixels(
    semantics: UInt8[np.ndarray, "X Y Z"],
    grid: VoxelGrid,
    camera_from_occ: Float[Tensor, "4 4"],
    pix_from_camera: Float[Tensor, "3 3"],
    size_pix: tuple[int, int],
    stride: int,
) -> tuple[Int64[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Returns class and z-depth in metres at the centers of squares of ``stride`` pixels.

    ``size_pix`` is the image's width and height.
    """
    # Centers of the coarse squares, in pixels of the image.
    width, height = (side // stride for side in size_pix)
    pix = stride * pixel_centers(width, height).flatten(0, 1)
    origin, directions = rays_in_grid(pix, camera_from_occ, pix_from_camera, grid)
    rays = origin.numpy(), directions.contiguous().numpy()

    classes = np.full((height, width), FREE, np.int64)
    depth_m = np.zeros((height, width), np.float32)
    _march(semantics, semantics < FREE, *rays, classes.reshape(-1), depth_m.reshape(-1))
    return torch.from_numpy(classes), torch.from_numpy(depth_m)


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
