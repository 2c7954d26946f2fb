"""Damages scored on two grids along one flight: the near one is a part of the paper's."""

import torch

from src.geometry import VoxelGrid
from studies.foretelling.horizon import SCALES, grid_of, write_flights


def test_the_near_grid_is_the_middle_of_the_papers():
    near, paper = (VoxelGrid(**grid_of(SCALES[name])) for name in ("near", "paper"))
    assert near.voxel_m == paper.voxel_m
    index, inside = paper.index_of(near.centers(torch.float64))
    assert inside.all()
    assert torch.equal(
        paper.centers(torch.float64)[tuple(index.movedim(-1, 0))], near.centers(torch.float64)
    )


def test_published_flights_are_those_of_the_plan(tmp_path):
    write_flights(["voxels_0.2", "seen"], tmp_path)
    found = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("*/*/flown/*"))
    assert found == ["anchors/seen/flown/flights.csv", "damaged/voxels_0.2/flown/flights.csv"]
    lines = (tmp_path / found[0]).read_text().splitlines()
    assert len(lines) == 161
