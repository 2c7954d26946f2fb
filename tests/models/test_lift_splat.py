import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid, front_mount, pixel_centers, unproject
from src.models.backbone import STRIDES
from src.models.lift_splat import LiftSplat, farthest_m, rays_camera
from src.models.references import PillarReferences
from tests.models.synthetic import IMAGE_SIZE, seen_by

GRID = VoxelGrid((0, -10, -10), (20, 10, 10), (10, 10, 10))
DIM, HEIGHTS = 6, 4
WIDTH, HEIGHT = IMAGE_SIZE
ATTITUDES_RAD = [(0.3, -0.2), (-0.4, 0.25)]
MOUNT = front_mount((0.3, 0.1, -0.2), pitch_rad=0.1)


def references_of():
    return seen_by(PillarReferences(GRID, HEIGHTS, "attitude"), ATTITUDES_RAD, MOUNT)


def random_lift(**settings):
    torch.manual_seed(0)
    lift = LiftSplat(DIM, HEIGHTS, GRID, **settings)
    torch.nn.init.normal_(lift.depth.weight)
    return lift


def slow_lift(lift, features):
    """Pixel by pixel and bin by bin, forwards: camera, occ, pillar and slice."""
    focal, voxel_m, slice_m = WIDTH / 2, 2.0, 20.0 / HEIGHTS
    feature = features[STRIDES.index(lift.stride)]
    out = [[torch.zeros(DIM) for _ in range(100)] for _ in ATTITUDES_RAD]
    count = 0
    for b, occ_from_camera in enumerate(references_of().camera_from_volume.inverse()):
        for i, j in torch.cartesian_prod(*map(torch.arange, feature.shape[2:])).tolist():
            context = lift.context(feature[b, :, i, j])
            probability = lift.depth(feature[b, :, i, j]).softmax(0)
            for number, share in enumerate(probability):
                d = lift.near_m + (number + 0.5) * lift.step_m
                u, v = (j + 0.5) * lift.stride, (i + 0.5) * lift.stride
                camera = [(u - WIDTH / 2) / focal * d, (v - HEIGHT / 2) / focal * d, d, 1.0]
                x, y, z, _ = (occ_from_camera @ torch.tensor(camera)).tolist()
                if 0 <= x < 20 and -10 <= y < 10 and -10 <= z < 10:
                    pillar = 10 * int(x / voxel_m) + int((y + 10) / voxel_m)
                    projection = lift.output[int((z + 10) / slice_m)]
                    out[b][pillar] = out[b][pillar] + share * context @ projection
                    count += 1
    assert 0 < count < feature[:, 0].numel() * lift.num_bins, "some lie outside"
    return torch.stack([torch.stack(pillars) for pillars in out])


@pytest.mark.parametrize("is_exporting", [False, True])
@pytest.mark.parametrize(
    "settings", [{}, {"stride": 32, "near_m": 0.5, "far_m": 21, "step_m": 0.9}]
)
def test_it_equals_the_loops_in_value_and_gradients(monkeypatch, settings, is_exporting):
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: is_exporting)
    torch.manual_seed(1)
    lift = random_lift(**settings)
    features = [torch.randn(2, DIM, HEIGHT // s, WIDTH // s).requires_grad_() for s in STRIDES]
    fast, slow = lift(None, features, references_of()), slow_lift(lift, features)
    torch.testing.assert_close(fast, slow)
    assert 0 < slow.eq(0).sum() == fast.eq(0).sum(), "exactly zero where nothing falls"

    inputs = [features[STRIDES.index(lift.stride)], *lift.parameters()]
    upstream = torch.randn_like(fast)
    gradients = (torch.autograd.grad(update, inputs, upstream) for update in (fast, slow))
    torch.testing.assert_close(*gradients, atol=1e-4, rtol=1e-4)


def test_bfloat16_autocast_moves_no_point():
    lift, references = random_lift(), references_of()
    where = lift._cells(references, 6, 4)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert all(a.equal(b) for a, b in zip(lift._cells(references, 6, 4), where))


def test_bins_reach_the_grids_farthest_corner_by_default():
    lift = LiftSplat(8, 8, VoxelGrid())
    assert farthest_m(VoxelGrid()) == pytest.approx(59.37, abs=0.01)
    assert (lift.step_m, lift.num_bins) == (0.5, 117)
    assert LiftSplat(8, 8, VoxelGrid(), far_m=60.0).num_bins == 118


@pytest.mark.parametrize(
    ("settings", "key"),
    [({"stride": 12}, "stride"), ({"far_m": 0.5}, "near_m"), ({"step_m": 0}, "step_m")],
)
def test_settings_that_cannot_be_are_refused(settings, key):
    with pytest.raises(UserError, match=key):
        LiftSplat(DIM, HEIGHTS, GRID, **settings)


def test_rays_are_those_of_the_inverted_camera_matrix():
    pix = 4 * pixel_centers(24, 16).float().flatten(0, 1)
    cameras = torch.tensor([[[50.0, 3.0, 40.0], [0, 60.0, 30.0], [0, 0, 1]]]).repeat(2, 1, 1)
    cameras[1, 0, 0] = -45.0  # a mirrored one
    for n in range(2):
        expected = unproject(pix, torch.ones(len(pix)), cameras[n])
        torch.testing.assert_close(rays_camera(24, 16, 4, cameras)[n], expected)
