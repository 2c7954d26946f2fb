import math

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid, front_mount, pinhole, rigid, rotation_from_euler, unproject
from src.models.backbone import STRIDES
from src.models.lift_splat import LiftSplat, farthest_m, rays_camera, splat, splat_by_adding
from src.models.references import PillarReferences

GRID = VoxelGrid((0, -10, -10), (20, 10, 10), (10, 10, 10))
DIM, HEIGHTS = 6, 4
WIDTH, HEIGHT = 96, 64
ATTITUDES = [(0.3, -0.2), (-0.4, 0.25), (0.0, 0.0)]
"""Roll and pitch in radians."""
MOUNT = front_mount((0.3, 0.1, -0.2), pitch_rad=0.1).float()


def tilts(attitudes):
    """occ_from_body of every attitude."""
    roll, pitch = torch.tensor(attitudes).T
    return rigid(rotation_from_euler(roll, pitch, torch.zeros_like(roll)), torch.zeros(3))


def references_of(attitudes, mount=MOUNT):
    number, size = len(attitudes), (WIDTH, HEIGHT)
    cameras = pinhole(*size, math.radians(90)).float().expand(number, 3, 3)
    references = PillarReferences(GRID, HEIGHTS, "attitude")
    return references(tilts(attitudes), mount.expand(number, 4, 4), cameras, size)


def features_of(batch, fill=torch.randn):
    torch.manual_seed(1)
    return [fill(batch, DIM, HEIGHT // s, WIDTH // s) for s in STRIDES]


def random_lift(**settings):
    torch.manual_seed(0)
    lift = LiftSplat(DIM, HEIGHTS, GRID, **settings)
    torch.nn.init.normal_(lift.depth.weight)
    return lift


def one_hot_lift(at_bin, **settings):
    """What every pixel shows is its feature, and stands at one depth."""
    lift = random_lift(**settings)
    lift.context.weight.data = torch.eye(DIM)
    lift.context.bias.data.zero_()
    lift.depth.weight.data.zero_()
    lift.depth.bias.data = torch.where(torch.arange(lift.num_bins) == at_bin, 1e4, 0.0)
    return lift


def slow_lift(lift, features, attitudes, mount=MOUNT):
    """Pixel by pixel and bin by bin, forwards: camera, body, occ, pillar and slice."""
    focal, voxel_m, slice_m = WIDTH / 2, 2.0, 20.0 / HEIGHTS
    feature = features[STRIDES.index(lift.stride)]
    out = [[torch.zeros(DIM) for _ in range(100)] for _ in attitudes]
    count = 0
    for b, tilt in enumerate(tilts(attitudes)):
        for i, j in torch.cartesian_prod(*map(torch.arange, feature.shape[2:])).tolist():
            context = lift.context(feature[b, :, i, j])
            probability = lift.depth(feature[b, :, i, j]).softmax(0)
            for number, share in enumerate(probability):
                d = lift.near_m + (number + 0.5) * lift.step_m
                u, v = (j + 0.5) * lift.stride, (i + 0.5) * lift.stride
                camera = [(u - WIDTH / 2) / focal * d, (v - HEIGHT / 2) / focal * d, d, 1.0]
                x, y, z, _ = (tilt @ mount @ torch.tensor(camera)).tolist()
                if 0 <= x < 20 and -10 <= y < 10 and -10 <= z < 10:
                    pillar = 10 * int(x / voxel_m) + int((y + 10) / voxel_m)
                    projection = lift.output[int((z + 10) / slice_m)]
                    out[b][pillar] = out[b][pillar] + share * context @ projection
                    count += 1
    assert 0 < count < len(attitudes) * feature[0, 0].numel() * lift.num_bins, "some lie outside"
    return torch.stack([torch.stack(pillars) for pillars in out])


@pytest.mark.parametrize(
    "settings", [{}, {"stride": 32, "near_m": 0.5, "far_m": 21, "step_m": 0.9}]
)
def test_it_equals_the_loops_in_value_and_gradients(settings):
    attitudes, lift = ATTITUDES[:2], random_lift(**settings)
    features = [f.requires_grad_() for f in features_of(2)]
    fast = lift(None, features, references_of(attitudes))
    slow = slow_lift(lift, features, attitudes)
    torch.testing.assert_close(fast, slow)

    inputs = [features[STRIDES.index(lift.stride)], *lift.parameters()]
    upstream = torch.randn_like(fast)
    gradients = (torch.autograd.grad(update, inputs, upstream) for update in (fast, slow))
    torch.testing.assert_close(*gradients, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("frame", range(len(ATTITUDES)))
def test_a_spot_at_a_known_depth_lands_in_its_pillar_and_height_alone(frame):
    """From the middle of a pillar's slice, through the projection chain, and back."""
    references = references_of(ATTITUDES)
    seen = (references.valid[frame] & (references.depth_m[frame] > 1.0)).nonzero().tolist()
    assert len(seen) > 100
    for pillar, height in seen[:: len(seen) // 12]:
        # Fine rays and bins: what is rounded is less than half a voxel.
        depth_m = references.depth_m[frame, pillar, height]
        lift = one_hot_lift(int((depth_m - 1.0) / 0.25), stride=4, step_m=0.25)
        features = features_of(len(ATTITUDES), torch.zeros)
        u, v = (references.pix[frame, pillar, height] / 4).int().tolist()
        features[0][frame, :, v, u] = spot = torch.randn(DIM)
        update = lift(None, features, references)
        assert update.ne(0).any(-1).nonzero().tolist() == [[frame, pillar]]
        torch.testing.assert_close(update[frame, pillar], spot @ lift.output[height])


def test_what_is_predicted_nowhere_in_the_grid_counts_for_nothing():
    lift = one_hot_lift(at_bin=99, far_m=100.0, step_m=0.9)
    assert lift(None, features_of(1), references_of(ATTITUDES[:1])).eq(0).all()


def test_all_of_a_frames_probability_lands_where_the_grid_holds_every_point():
    lift = one_hot_lift(at_bin=1)
    for projection in lift.output.data:
        projection.copy_(torch.eye(DIM))
    features = features_of(1)
    update = lift(None, features, references_of([(0.0, 0.0)]))
    torch.testing.assert_close(update.sum(1), features[2].sum((2, 3)))


def test_pillars_that_nothing_falls_into_get_exactly_zero():
    lift, references = random_lift(), references_of(ATTITUDES)
    cell, inside = lift._cells(references, WIDTH // 16, HEIGHT // 16)
    hit = torch.zeros(3 * 100, dtype=torch.bool)
    hit[cell[inside] // HEIGHTS] = True
    assert 0 < hit.sum() < 300
    assert lift(None, features_of(3), references).ne(0).any(-1).flatten().equal(hit)


def test_a_camera_that_sees_no_pillar_gives_zero_and_finite_gradients():
    backwards = MOUNT.clone()
    backwards[:2] *= -1
    lift, references = random_lift(), references_of(ATTITUDES[2:], backwards)
    update = lift(None, [f.requires_grad_() for f in features_of(1)], references)
    assert update.eq(0).all()
    update.sum().backward()
    assert all(p.grad.eq(0).all() for p in lift.parameters())


def test_padding_and_the_query_change_nothing():
    lift, references, features = random_lift(), references_of(ATTITUDES), features_of(3)
    padded = references._replace(in_view=torch.full((3 * 400,), 3 * 400))
    expected = lift(torch.zeros(1, 100, DIM), features, references)
    assert lift(torch.ones(1, 100, DIM), features, padded).equal(expected)


def test_a_frame_does_not_depend_on_the_rest_of_the_batch():
    lift, features = random_lift(), features_of(3)
    together = lift(None, features, references_of(ATTITUDES))
    alone = lift(None, [f[1:2] for f in features], references_of(ATTITUDES[1:2]))
    torch.testing.assert_close(together[1:2], alone)


def test_bfloat16_autocast_moves_no_point():
    lift, features, references = random_lift(), features_of(3), references_of(ATTITUDES)
    plain = lift(None, features, references)
    where = lift._cells(references, 6, 4)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert all(a.equal(b) for a, b in zip(lift._cells(references, 6, 4), where))
        mixed = lift(None, [f.bfloat16().requires_grad_() for f in features], references)
    assert (mixed - plain).abs().mean() < 0.02 * plain.std()
    mixed.float().square().sum().backward()
    assert all(p.grad.isfinite().all() for p in lift.parameters())


@pytest.mark.parametrize("way", [splat, splat_by_adding])
def test_the_splat_and_that_of_an_exported_graph_are_the_sum_and_pass_gradcheck(way):
    generator = torch.Generator().manual_seed(0)
    context = torch.randn(5, 3, generator=generator).double().requires_grad_()
    probability = torch.rand(5, 4, generator=generator).double().requires_grad_()
    cell = torch.randint(0, 7, (5, 4), generator=generator)
    inside = torch.rand(5, 4, generator=generator) < 0.7
    cell[~inside] = 10**9

    def summed(context, probability):
        return way(context, probability, cell, inside, 7)

    expected = torch.zeros(7, 3).double()
    for row, bin_ in inside.nonzero().tolist():
        expected[cell[row, bin_]] += probability[row, bin_] * context[row]
    torch.testing.assert_close(summed(context, probability), expected)
    assert torch.autograd.gradcheck(summed, (context, probability))


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
    generator = torch.Generator().manual_seed(0)
    pix = 100 * torch.rand(12, 2, generator=generator)
    cameras = torch.tensor([[[50.0, 3.0, 40.0], [0, 60.0, 30.0], [0, 0, 1]]]).repeat(2, 1, 1)
    cameras[1, 0, 0] = -45.0  # a mirrored one
    for n in range(2):
        expected = unproject(pix, torch.ones(12), cameras[n])
        torch.testing.assert_close(rays_camera(pix, cameras)[n], expected)
