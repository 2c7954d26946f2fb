import math

import pytest
import torch
import torch.nn.functional as F

from src.errors import UserError
from src.geometry import front_mount, transform
from src.models.references import PillarReferences
from src.models.sight import Matching, Sight, SightHead, depth_error, place_of, rays
from tests.models.synthetic import GRID, IMAGE_SIZE, seen_by, sure_sight

WIDTH, HEIGHT = (side // 4 for side in IMAGE_SIZE)
HEIGHTS_M = torch.tensor([6.0, 15.0])
BINS = 12
SHAPE = (2, BINS, HEIGHT, WIDTH)


def references_of(projection="attitude"):
    attitudes_rad, mount = [(0.2, 0.1), (-0.1, 0.3)], front_mount((0.1, 0.0, -0.05))
    return seen_by(PillarReferences(GRID, 4, projection), attitudes_rad, mount, HEIGHTS_M)


def test_the_ground_if_there_is_one_is_where_the_pixels_rays_meet_it():
    references = references_of()
    _, ground_m, meets = rays(references, WIDTH, HEIGHT, 4, has_ground=True)
    assert 0.2 < meets.float().mean() < 0.8
    for frame, row, column in meets[:, 0].nonzero()[::37].tolist():
        u, v = 4 * column + 2, 4 * row + 2
        focal, center_u, center_v = IMAGE_SIZE[0] / 2, IMAGE_SIZE[0] / 2, IMAGE_SIZE[1] / 2
        depth_m = ground_m[frame, 0, row, column]
        point = torch.tensor([(u - center_u) / focal, (v - center_v) / focal, 1.0]) * depth_m
        on_ground = transform(references.camera_from_volume[frame].inverse(), point[None])[0]
        assert abs(on_ground[2]) < 1e-3

    told, _, meets = rays(references, WIDTH, HEIGHT, 4, has_ground=False)
    assert not meets.any()
    assert not told[:, 2:].any()


def test_a_level_rung_is_told_the_rays_of_level_flight():
    told = rays(references_of("level"), WIDTH, HEIGHT, 4, has_ground=True)[0]
    assert torch.allclose(told[:, 1, :, 0], told[:, 1, :, -1], atol=1e-6), "no row is tilted"
    tilted = rays(references_of(), WIDTH, HEIGHT, 4, has_ground=True)[0]
    assert not torch.allclose(tilted[:, 1, :, 0], tilted[:, 1, :, -1], atol=0.05)


def test_the_losses_fall_towards_the_truth():
    head = SightHead(8, BINS)
    batch = {
        "pixel_class": torch.full((2, HEIGHT, WIDTH), 3, dtype=torch.uint8),
        "pixel_depth_m": torch.full((2, HEIGHT, WIDTH), 10.0),
    }
    right, wrong = (head.losses(sure_sight(depth_m, SHAPE), batch) for depth_m in (10.0, 30.0))
    assert right["pixel_depth"] < 1e-6 < wrong["pixel_depth"]
    beyond = {**batch, "pixel_depth_m": torch.full((2, HEIGHT, WIDTH), math.inf)}
    assert head.losses(sure_sight(10.0, SHAPE), beyond)["pixel_depth"].isfinite()


def test_a_pixel_weighs_as_its_class_says():
    weights = [1, 2, *[1] * 7]
    sight = Sight(torch.randn(1, 9, 1, 2), torch.zeros(1, BINS + 1, 1, 2))
    of_pixel = -sight.classes.log_softmax(1)[0, [0, 1], 0, [0, 1]]
    labels = {"pixel_class": torch.tensor([[[0, 1]]]), "pixel_depth_m": torch.full((1, 1, 2), 5.0)}
    found = SightHead(4, BINS, class_weights=weights).losses(sight, labels)["pixel_class"]
    torch.testing.assert_close(found, (of_pixel[0] + 2 * of_pixel[1]) / 3)

    head = SightHead(4, BINS, class_weights=weights)
    labels["pixel_class"] = torch.tensor([[[0, 255]]])
    torch.testing.assert_close(head.losses(sight, labels)["pixel_class"], of_pixel[0])
    labels["pixel_class"] = torch.tensor([[[255, 255]]])
    assert head.losses(sight, labels)["pixel_class"] == 0

    for wrong in ([1.0] * 8, [0.0] * 9):
        with pytest.raises(UserError, match=r"model\.sight\.class_weights"):
            SightHead(4, class_weights=wrong)


def test_the_error_is_that_of_the_logarithm_where_something_is_near():
    depth_m = torch.full((2, HEIGHT, WIDTH), 10.0)
    depth_m[:, 0] = math.inf
    sight = sure_sight(20.0, SHAPE)
    error, counts = depth_error(sight, depth_m)
    assert counts.sum() == 2 * (HEIGHT - 1) * WIDTH
    expected = (sight.depth_m()[0, 0, 0] / 10).log()
    torch.testing.assert_close(error[counts > 0].mean(), expected)


def test_the_median_lies_within_a_bin_as_its_shares_say():
    depth = torch.full((1, 49, 1, 1), -50.0)
    depth[0, 20:22] = torch.tensor([0.3, 0.7]).log()[:, None, None]
    median_m = Sight(torch.zeros(1, 9, 1, 1), depth).depth_m()
    assert place_of(median_m, 48).item() == pytest.approx(21 + 0.2 / 0.7, abs=1e-4)


def test_the_matching_is_three_convolutions_in_3d():
    torch.manual_seed(0)
    matching, volume = Matching(4), torch.rand(2, 6, 5, 7)
    x = volume[:, None]
    for number, layer in enumerate(matching.layers):
        torch.nn.init.zeros_(layer.bias)
        # The outputs for the bins behind come first: these read the first slice of a 3-D kernel.
        kernel = layer.weight.unflatten(0, (3, -1)).permute(1, 2, 0, 3, 4)
        x = F.conv3d(torch.relu(x) if number else x, kernel, padding=1)
    assert matching(volume).allclose(x[:, 0], atol=1e-6)


def test_a_head_that_knows_nothing_begins_with_the_ground():
    torch.manual_seed(0)
    references = references_of()
    head = SightHead(8, 48)
    for parameter in head.layers[-1].parameters():
        torch.nn.init.zeros_(parameter)
    sight = head(torch.randn(2, 8, HEIGHT, WIDTH), references, has_ground=True)
    _, ground_m, meets = rays(references, WIDTH, HEIGHT, 4, has_ground=True)
    probable = sight.depth.argmax(dim=1)[:, None][meets]
    assert (probable - (place_of(ground_m, 48) - 0.5)[meets]).abs().max() <= 0.5 + 1e-3
