import math

import pytest
import torch
import torch.nn.functional as F

from src.errors import UserError
from src.geometry import VoxelGrid, rigid, rotation_from_euler
from src.models.history import DZ_SCALE_M, History, TemporalAttention, align_history

GRID = VoxelGrid(shape=(20, 20, 12))


def moved(dx_m=0.0, dy_m=0.0, dz_m=0.0, yaw_rad=0.0):
    """occ_from_past_occ [1, 1, 4, 4]."""
    zero = torch.zeros(1, 1)
    rotation = rotation_from_euler(zero, zero, zero + yaw_rad)
    return rigid(rotation, torch.tensor([dx_m, dy_m, dz_m]).view(1, 1, 3))


def history_of(pillars, occ_from_past_occ):
    return History(pillars, occ_from_past_occ, torch.ones(pillars.shape[:2], dtype=torch.bool))


def ramp():
    """Past pillars that hold their own center: bilinear sampling keeps a linear map exact."""
    return GRID.centers()[:, :, 0, :2].flatten(0, 1)[None, None]


@pytest.mark.parametrize("motion", [{"dx_m": -5.0}, {"dx_m": -4.0, "dy_m": 2.0, "yaw_rad": -0.2}])
def test_a_pillar_finds_its_own_place_in_the_past(motion):
    """What stood at x_past is now at x_past turned and shifted, worked out by hand."""
    aligned = align_history(history_of(ramp(), moved(**motion)), GRID)
    yaw, dx, dy = (motion.get(k, 0.0) for k in ("yaw_rad", "dx_m", "dy_m"))
    x, y = aligned.pillars[0, 0].unbind(-1)
    x_now = math.cos(yaw) * x - math.sin(yaw) * y + dx
    y_now = math.sin(yaw) * x + math.cos(yaw) * y + dy

    # Within half a cell of the border the resampled ramp is flat.
    inner = aligned.valid[0, 0] & (x > 1.3) & (x < 48.7) & (y.abs() < 23.7)
    assert inner.sum() > 200
    now = torch.stack([x_now, y_now], dim=-1)[inner]
    torch.testing.assert_close(now, ramp()[0, 0][inner], atol=1e-4, rtol=1e-5)


def test_what_left_the_grid_is_masked_and_climbing_shows_in_dz_alone():
    aligned = align_history(history_of(ramp(), moved(dx_m=-10.0)), GRID)
    valid = aligned.valid.view(20, 20)
    assert valid[:16].all(), "10 m at 2.5 m a pillar: four rows are new"
    assert not valid[16:].any()
    assert aligned.pillars.view(20, 20, 2)[16:].eq(0).all()

    aligned = align_history(history_of(ramp(), moved(dz_m=-3.0)), GRID)
    torch.testing.assert_close(aligned.pillars, ramp())
    assert aligned.dz_m.item() == -3.0


def attention_query_history(frames=3):
    """What the attention is asked with, two frames of a batch with a past that moves away."""
    torch.manual_seed(0)
    attention = TemporalAttention(8, num_heads=2, num_frames=4)
    motion = torch.cat([moved(dx_m=-float(i)) for i in range(frames)], dim=1)
    history = history_of(torch.randn(2, frames, 400, 8), motion.repeat(2, 1, 1, 1))
    return attention, torch.randn(2, 400, 8), history


@pytest.mark.parametrize("garbage", [1e6, float("nan"), float("inf")])
def test_a_frame_that_does_not_exist_changes_nothing(garbage):
    attention, query, history = attention_query_history()
    history.valid[0, 0] = False
    expected = attention(query, align_history(history, GRID))

    pillars, motion = history.pillars.clone(), history.occ_from_past_occ.clone()
    pillars[0, 0], motion[0, 0] = garbage, garbage
    pillars.requires_grad_()
    got = attention(query, align_history(History(pillars, motion, history.valid), GRID))
    assert got.equal(expected)

    got.sum().backward()
    assert pillars.grad.isfinite().all()
    assert all(p.grad.isfinite().all() for p in attention.parameters())


def test_a_short_queue_equals_a_padded_one_and_no_history_one_without_a_valid_frame():
    """Ages count back from the current frame, wherever the queue begins."""
    attention, query, history = attention_query_history()
    for last in (True, False):
        padded = history._replace(valid=torch.tensor([False, False, last]).expand(2, 3))
        short = align_history(History(*(x[:, -1:] for x in history)), GRID) if last else None
        of_padded = attention(query, align_history(padded, GRID))
        torch.testing.assert_close(of_padded, attention(query, short))


def test_attention_is_the_softmax_over_the_frames_that_exist():
    """Eq. 7 as PyTorch's own attention of every pillar to its past, its oldest frame first."""
    attention, query, history = attention_query_history()
    history.valid[0, 0] = False
    aligned = align_history(history, GRID)
    rise = attention.dz(aligned.dz_m[..., None] / DZ_SCALE_M)
    past = aligned.pillars + (attention.age[[3, 2, 1]] + rise)[:, :, None]
    tokens = torch.cat([past, (query + attention.age[0])[:, None]], dim=1).transpose(1, 2)

    keys, values = attention.key_value(tokens).chunk(2, dim=-1)
    asked, keys, values = (
        x.unflatten(-1, (2, 4)).transpose(2, 3)
        for x in (attention.query(query)[:, :, None], keys, values)
    )
    exists = F.pad(aligned.valid, (0, 0, 0, 1), value=True).transpose(1, 2)[:, :, None, None]
    mean = F.scaled_dot_product_attention(asked, keys, values, exists)
    expected = attention.output(mean[..., 0, :].flatten(-2))
    torch.testing.assert_close(attention(query, aligned), expected)


def test_more_frames_than_it_was_built_for_are_refused():
    attention, query, history = attention_query_history(frames=4)
    with pytest.raises(UserError, match="5 frames, but the model was built for 4"):
        attention(query, align_history(history, GRID))
