"""TartanGround's semantic occupancy: one ``semantic_occupancy_<pose>.npz`` a pose, to be scored."""

from pathlib import Path

import numpy as np

from ..data.files import BROKEN, array_of, fault_of, files_below, open_npz
from ..errors import UserError
from ..geometry import VoxelGrid
from .label_format import Ids, LabelFormat, Sample

START = "semantic_occupancy_"


class TartanGround(LabelFormat):
    """``<trajectory>/sem_occ/semantic_occupancy_<pose>.npz``, as its tools cut them from a cloud.

    Their axes are forward, right and down, and follow the robot. Behind the last voxel of an axis
    they have a plane for points on the very bound, which is left out. They have no masks, and 0 is
    both free and not labelled.
    """

    name = "tartanground"
    pattern = f"<trajectory>/sem_occ/{START}<pose>.npz"

    def find(self, root: Path, predicted: bool) -> dict[Sample, Path]:
        return {
            (path.parent.relative_to(root).as_posix(), path.stem[len(START) :]): path
            for path in files_below(root, f"{START}*.npz")
        }

    def read(self, path: Path, grid: VoxelGrid) -> Ids:
        try:
            with open_npz(path) as archive:
                ids = array_of(archive, "occupancy_map")
                bounds_m, voxel_m = array_of(archive, "bounds"), array_of(archive, "resolution")
        except BROKEN as error:
            raise UserError(f"{path}: cannot be read ({error})") from error

        if fault := fault_of(ids):
            raise UserError(f"{path}: occupancy_map {fault}")
        if ids.shape != tuple(size + 1 for size in grid.shape):
            raise UserError(
                f"{path}: occupancy_map is {list(ids.shape)}, which is a plane more than its grid "
                f"each way, and layout.grid.shape is {list(grid.shape)}; state it as it is"
            )
        # In their order and axes.
        (x, y, z), (x_end, y_end, z_end) = grid.lower_m, grid.upper_m
        stated_m = [x, x_end, -y_end, -y, -z_end, -z]
        if bounds_m.shape != (6,) or not np.allclose(
            [*bounds_m, voxel_m], [*stated_m, grid.voxel_m]
        ):
            raise UserError(
                f"{path}: its bounds are {bounds_m.tolist()} m (forward, right, down) of {voxel_m} "
                f"m, and those of layout.grid {stated_m} of {grid.voxel_m}; state it as it is"
            )
        return ids[:-1, -2::-1, -2::-1].astype(np.int64)
