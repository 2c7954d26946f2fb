"""task=check's eyes: what it counts and what it finds, on clips with known faults."""

from collections import Counter

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.check import agreement_of, problems_of, shares_of
from src.data.clip import ACTOR_COLUMNS, FRAME_COLUMNS, Clip, ClipMeta, ClipWriter, poses_of
from src.geometry import (
    VoxelGrid,
    camera_from_occ,
    front_mount,
    in_image,
    pinhole,
    project,
    quat_from_euler,
)
from src.ontology import BUILDING, CAR, FREE, SKY, UNKNOWN

WIDTH, HEIGHT, FRAMES = 64, 32, 30
GRID = VoxelGrid((0, -16, -8), (16, 16, 8), (16, 32, 16))
DEPTH_M = 10.4
META = ClipMeta(
    *("park", "clear", 0, 2.5, WIDTH, HEIGHT),
    pinhole(WIDTH, HEIGHT, np.pi / 2),
    front_mount((0.0, 0.0, 0.0)),
    GRID,
)


def table(roll=0.0, pitch=0.0, yaw=0.5):
    rows = pd.DataFrame(np.zeros((FRAMES, len(FRAME_COLUMNS))), columns=FRAME_COLUMNS)
    rows["frame"], rows["time_s"] = np.arange(FRAMES), np.arange(FRAMES) / 2.5
    rows[["roll_rad", "pitch_rad", "yaw_rad"]] = roll, pitch, yaw
    angles = torch.tensor([roll, pitch, yaw], dtype=torch.float64)
    rows[["qx", "qy", "qz", "qw"]] = quat_from_euler(*angles).tolist()
    return rows


def frustum(rows):
    chain = camera_from_occ(poses_of(rows)[0], META.body_from_camera)
    centers = GRID.centers(torch.float64).reshape(-1, 3)
    pix, depth_m = project(centers, chain, META.pix_from_camera)
    return in_image(pix, depth_m, WIDTH, HEIGHT).numpy().reshape(GRID.shape)


def free_labels(rows):
    return np.where(frustum(rows), FREE, UNKNOWN).astype(np.uint8)


def wall_labels(rows):
    """A wall across the view at x in [10, 11) of the grid, free space before it."""
    labels = np.full(GRID.shape, UNKNOWN, np.uint8)
    labels[:10], labels[10] = FREE, BUILDING
    labels[~frustum(rows)] = UNKNOWN
    return labels


def write(folder, rows, labels, class_id=BUILDING):
    """A clip of a level or tilted UAV; its depth image is the wall's when it is level."""
    depth_m = np.full((HEIGHT, WIDTH), DEPTH_M, np.float32)
    classes = np.full((HEIGHT, WIDTH), class_id, np.uint8)
    depth_m[0], classes[0] = np.inf, SKY
    with ClipWriter(folder, META) as writer:
        for frame in range(FRAMES):
            writer.add_image(frame, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
            writer.add_labels(frame, labels, labels == FREE)
            writer.add_aux(frame, depth=depth_m, **{"class": classes})
        writer.add_tables(rows, pd.DataFrame(columns=ACTOR_COLUMNS))
    return folder


# ---------------------------------------------------------------------------------- agreement


def test_sound_labels_agree_wholly_and_counts_add_up_over_frames(tmp_path):
    clip = Clip(write(tmp_path / "c", table(), wall_labels(table())))
    counts = agreement_of(clip, 4)
    in_view = frustum(table())[10][wall_voxels()]
    # At the border of the image points lie in voxels whose centers are outside of it.
    assert counts["pixels"] == in_view.sum() < in_view.size
    assert counts["occupied"] == counts["own class"] == counts["pixels"]
    assert counts["free with point"] == 0
    assert counts["free voxels"] == (wall_labels(table()) == FREE).sum()
    assert shares_of(counts + agreement_of(clip, 1)) == shares_of(counts)
    assert not any(shares_of(Counter()).values())


def test_the_wrong_class_the_wrong_place_and_free_on_a_surface_are_counted(tmp_path):
    rows = table()
    other = agreement_of(Clip(write(tmp_path / "class", rows, wall_labels(rows), CAR)), 4)
    assert other["occupied"] == other["pixels"] > other["own class"] == 0
    moved = np.roll(wall_labels(rows), -1, axis=0)
    moved[10] = FREE
    moved[~frustum(rows)] = UNKNOWN
    wrong = agreement_of(Clip(write(tmp_path / "moved", rows, moved)), 4)
    assert wrong["occupied"] == 0
    held = np.zeros(GRID.shape[1:], dtype=bool)
    held[wall_voxels()] = True
    assert wrong["free with point"] == (frustum(rows)[10] & held).sum() > 0


def wall_voxels():
    """Where in the wall every pixel's point lies, but for the first row, which is sky."""
    focal = WIDTH / 2
    v, u = np.mgrid[1:HEIGHT, 0:WIDTH] + 0.5
    left_m, up_m = (WIDTH / 2 - u) * DEPTH_M / focal, (HEIGHT / 2 - v) * DEPTH_M / focal
    return np.floor(left_m + 16).astype(int), np.floor(up_m + 8).astype(int)


# ----------------------------------------------------------------------------------- problems


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.5), (0.3, -0.2, 3.1), (-0.2, 0.25, -3.1)])
def test_a_sound_clip_has_no_problem_and_an_angle_that_is_not_the_quaternion_s_is_one(
    tmp_path, attitude
):
    rows = table(*attitude)
    labels = free_labels(rows)
    assert list(problems_of(write(tmp_path / "sound", rows, labels))) == []
    rows.loc[4, "yaw_rad"] += 0.01
    (problem,) = problems_of(write(tmp_path / "c", rows, labels))
    assert "frame 4" in problem


@pytest.mark.parametrize("truth", [(-0.3, 0.1), (0.6, 0.1), (0.3, -0.1), (0.3, 0.2)])
def test_labels_made_under_another_attitude_are_found(tmp_path, truth):
    labels = free_labels(table(*truth))
    problems = list(problems_of(write(tmp_path / "c", table(0.3, 0.1), labels)))
    assert len(problems) == FRAMES
    assert all(f"frame {n}:" in line for n, line in enumerate(problems))


def test_changed_bytes_are_found_before_anything_is_read(tmp_path):
    folder = write(tmp_path / "c", table(), wall_labels(table()))
    (folder / "rgb.zip").write_bytes((folder / "rgb.zip").read_bytes()[:-1] + b"x")
    (folder / "frames.csv").unlink()
    first, second = problems_of(folder)
    assert str(folder / "frames.csv") in first
    assert str(folder / "rgb.zip") in second
