"""What pixels see, against single voxels and against the volume that they were cast through."""

import math

import numpy as np
import pytest
import torch

from src.data.batches import Key
from src.data.dataset import OccupancyDataset
from src.data.image_labels import ImageLabelDataset, labels_of_pixels
from src.geometry import (
    VoxelGrid,
    camera_from_occ,
    front_mount,
    inverse,
    pinhole,
    pixel_centers,
    transform,
    unproject,
)
from src.ontology import FREE, UNKNOWN

GRID = VoxelGrid((0, -5, -5), (20, 5, 5), (20, 10, 10))
SIZE, STRIDE = (96, 64), 4
CAR, THIN = 5, 3
CHAIN = camera_from_occ(torch.eye(4), front_mount((0.0, 0.0, 0.0)).float())
PIX_FROM_CAMERA = pinhole(*SIZE, math.radians(90)).float()


def seen(*voxels):
    """Classes and depths where the volume holds these (index, class) and is free elsewhere."""
    semantics = np.full(GRID.shape, FREE, np.uint8)
    for index, label in voxels:
        semantics[index] = label
    return labels_of_pixels(semantics, GRID, CHAIN, PIX_FROM_CAMERA, SIZE, STRIDE)


def test_a_voxel_ahead_fills_its_pixels_with_its_class_and_the_depth_of_its_face():
    """Left of the axis and above it by half a metre, its face of 6 x 6 pixels is 8 m away."""
    classes, depth_m = seen(((8, 5, 5), CAR))
    assert classes.shape == depth_m.shape == (16, 24)
    rows, columns = (classes == CAR).nonzero().unbind(1)
    pix = 4 * torch.stack([columns, rows]) + 2
    # u = 48 - 48 y / x, v = 32 - 48 z / x, with y and z from 0 to 1 on the face at x = 8
    assert ((pix[0] > 48 - 6) & (pix[0] < 48)).all()
    assert ((pix[1] > 32 - 6) & (pix[1] < 32)).all()
    assert len(rows) == 1
    assert depth_m[classes == CAR].tolist() == [8.0]
    assert (classes != CAR).sum() == (classes == FREE).sum() == (depth_m == 0).sum()


def test_the_nearest_one_is_seen_and_what_has_no_label_is_not():
    near, far = ((4, 5, 5), THIN), ((8, 5, 5), CAR)
    assert not (seen(near, far)[0] == CAR).any()
    assert (seen(((4, 5, 5), UNKNOWN), far)[0] == CAR).any()


@pytest.fixture
def labelled(clips):
    clip_id = "downtown/clip00"
    frames = OccupancyDataset(clips, [(clip_id, 9)], 1, 0.2)
    return frames, clips[clip_id].meta.grid


def test_every_pixel_names_the_voxel_at_its_depth(labelled):
    frames, grid = labelled
    sample, pixels = frames[0], ImageLabelDataset(*labelled, STRIDE)[0]
    chain = camera_from_occ(sample["occ_from_body"][-1], sample["body_from_camera"]).double()
    hit = pixels["depth_m"] > 0
    assert hit.float().mean() > 0.1
    pix = STRIDE * pixel_centers(24, 16)[hit]
    inside = pixels["depth_m"][hit].double() + 1e-4
    points = unproject(pix, inside, sample["pix_from_camera"][-1].double())
    index, is_inside = grid.index_of(transform(inverse(chain), points))
    classes = sample["semantics"][tuple(index[is_inside].T)].long()
    assert (classes == pixels["classes"][hit][is_inside]).float().mean() > 0.99  # edges


def test_a_mirrored_frame_has_mirrored_labels(labelled):
    dataset = ImageLabelDataset(*labelled, STRIDE)
    plain, mirrored = dataset[Key(0)], dataset[Key(0, mirror=True)]
    for name, value in plain.items():
        same = (value.flip(-1) == mirrored[name]).float().mean()
        assert same > 0.99, name
    assert not plain["classes"].equal(mirrored["classes"])
