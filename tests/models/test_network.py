import copy

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid, front_mount
from src.models.backbone import ResNet
from src.models.decoder import PillarDecoder
from src.models.encoder import PillarEncoder
from src.models.history import History
from src.models.metadata import height_phases
from src.models.network import SkyOcc
from src.models.sight import SightHead
from tests.models.synthetic import (
    GRID,
    LIFTS,
    VOLUME,
    build_batch,
    build_lift,
    build_network,
    loss_of,
)

EACH_LIFT = pytest.mark.parametrize("lift", LIFTS)


def require_finite_step(network, batch):
    """Fails unless the loss, its gradients and what batch normalisation counts are numbers."""
    loss = loss_of(network, batch)
    loss.backward()
    gradients = [p.grad for p in network.parameters() if p.grad is not None]
    assert all(value.isfinite().all() for value in (loss, *gradients, *network.buffers()))


@pytest.mark.parametrize("volume", [None, VOLUME], ids=["occ", "ground"])
@EACH_LIFT
def test_the_stream_equals_the_batch_path_exactly(batch, lift, volume):
    """Pillars cached one frame at a time, then the current frame, against the whole queue."""
    network = build_network(lift=lift, volume=volume).eval()
    cached = [network.encode(batch, at).pillars for at in range(3)]
    streamed, left_behind, _ = network.step(batch, History.of(cached, batch))
    assert streamed.equal(network(batch))
    assert left_behind.equal(network.encode(batch, -1).pillars)


def kept_bytes(network, batch):
    """What the graph of a forward pass keeps for its backward."""
    kept = []
    with torch.autograd.graph.saved_tensors_hooks(kept.append, lambda _: None):
        network(batch)
    return sum(tensor.nbytes for tensor in kept)


def test_checkpointing_keeps_less(batch):
    plain, less = (kept_bytes(build_network(checkpointing=c), batch) for c in (False, True))
    assert less < 0.7 * plain


@EACH_LIFT
@pytest.mark.parametrize("history_grad", [False, True])
def test_checkpointing_changes_no_number(batch, history_grad, lift):
    """Neither the loss, nor a gradient, nor what batch normalisation has counted."""
    results = []
    for checkpointing in (False, True):
        settings = {"history_grad": history_grad, "checkpointing": checkpointing}
        network = build_network(lift=lift, **settings)
        loss_of(network, batch).backward()
        gradients = {name: p.grad for name, p in network.named_parameters() if p.grad is not None}
        results.append({**gradients, **dict(network.named_buffers())})
    torch.testing.assert_close(*results)


@pytest.mark.parametrize("training", [True, False])
def test_padded_frames_are_never_read(network, batch, training):
    network.train(training)
    batch["history_valid"][0, :2] = False
    expected = copy.deepcopy(network)(batch)
    spoilt = {name: value.clone() for name, value in batch.items()}
    spoilt["image"][0, :2] = 255 - spoilt["image"][0, :2]
    for name in ("pix_from_camera", "occ_from_body", "occ_from_past_occ"):
        spoilt[name][0, :2] = torch.nan
    assert network(spoilt).equal(expected)


def test_padded_frames_cost_nothing(network, batch):
    images = []
    network.backbone.register_forward_pre_hook(lambda _, inputs: images.append(len(inputs[0])))
    batch["history_valid"][0, :2] = False
    batch["history_valid"][:, 0] = False
    network(batch)
    assert images == [1, 2, 2]


def test_every_valid_past_frame_matters(network, batch):
    network.eval()
    before = network(batch)
    for frame in range(4):
        changed = {**batch, "image": batch["image"].index_fill(1, torch.tensor(frame), 0)}
        assert not torch.allclose(network(changed), before, atol=1e-4)


@EACH_LIFT
def test_a_camera_that_sees_no_pillar_gives_finite_output_and_gradients(batch, lift):
    network = build_network(lift=lift)
    backwards = front_mount((0.0, 0.0, 0.0)).float()
    backwards[:2] *= -1
    batch["body_from_camera"] = backwards.expand(2, 4, 4)
    require_finite_step(network, batch)


@pytest.mark.parametrize(
    ("batch_size", "image_size"), [(1, (96, 64)), (1, (64, 32)), (1, (32, 64)), (2, (32, 32))]
)
def test_a_training_step_of_the_smallest_batch_is_finite(network, batch_size, image_size):
    require_finite_step(network, build_batch(batch_size, image_size=image_size))


@EACH_LIFT
def test_every_parameter_learns(batch, lift):
    """What has no gradient at all would stop training on several devices."""
    network = build_network(lift=lift)
    # At its initial zero, nothing that feeds the prediction of offsets has a gradient yet.
    for layer in (*network.encoder.frame_layers, network.encoder.last_layer):
        if lift == "deformable":
            torch.nn.init.normal_(layer.lift.sampling.weight, std=0.1)
    loss_of(network, batch).backward()
    still = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert still == []


def test_levels_that_no_lift_reads_are_not_computed(batch):
    network = build_network(lift="lss")
    features = network.encode(batch, -1).features
    assert [feature is not None for feature in features] == [False, False, True, False]
    names = {name.rpartition(".")[0] for name in network.neck.state_dict()}
    assert names == {"lateral.2", "lateral.3", "output.2"}


@pytest.mark.parametrize("history_grad", [False, True])
def test_past_frames_give_gradient_only_when_asked(batch, history_grad):
    network, seen = build_network(history_grad=history_grad).eval(), []
    network.backbone.layer1.register_forward_hook(
        lambda _, __, output: seen.append(output.requires_grad)
    )
    network(batch)
    assert seen == [history_grad] * 3 + [True]


def test_running_statistics_see_the_current_frames_once(batch):
    network, other = build_network(), build_network()
    network(batch)
    batch["image"][:, :-1] = 0
    other(batch)
    norm = network.backbone.bn1
    assert norm.num_batches_tracked == 1
    assert norm.running_mean.equal(other.backbone.bn1.running_mean)
    assert norm.training
    assert not norm.running_mean.eq(0).all()


@EACH_LIFT
def test_level_ignores_attitude_except_as_metadata(batch, lift):
    tilted = {**batch, "occ_from_body": batch["occ_from_body"].roll(1, dims=0)}
    for projection, same in (("level", True), ("attitude", False)):
        network = build_network(lift=lift, encoder={"projection": projection}).eval()
        assert network(tilted).equal(network(batch)) is same


@pytest.mark.parametrize("first", [False, True])
def test_metadata_enter_after_the_lifting_or_if_asked_before_it(first):
    batch = build_batch(frames=1)
    other = {**batch, "velocity_mps": batch["velocity_mps"] + 1.0}
    network = build_network(encoder={"num_frames": 1}, metadata_first=first).eval()
    pillars = [network.encode(each, -1).pillars for each in (batch, other)]
    assert pillars[0].allclose(pillars[1]) is not first
    assert not network(other).allclose(network(batch))
    require_finite_step(network.train(), batch)


@pytest.mark.parametrize("names", [[], ["attitude"], ["velocity"], ["height"]])
def test_only_the_metadata_that_are_named_are_told(batch, names):
    keys = {"attitude": "attitude_rad", "velocity": "velocity_mps", "height": "height_m"}
    network = build_network(metadata=names).eval()
    for name, key in keys.items():
        other = {**batch, key: batch[key] + 0.3}
        assert network(other).equal(network(batch)) is (name not in names)


def test_a_height_moves_the_ground_by_as_many_voxels():
    """The phases of a height are the same rotation apart wherever it is."""
    phases = height_phases(torch.tensor([2.0, 2.5, 9.0, 9.5]))
    low, low_up, high, high_up = torch.complex(*phases.flip(-1).chunk(2, dim=-1))
    torch.testing.assert_close(low_up / low, high_up / high, atol=1e-4, rtol=0)
    assert (low_up / low - 1).abs().max() > 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        *(({"metadata": names}, r"model\.metadata: ") for names in (True, "height", ["depth"])),
        ({"metadata_first": True}, r"model\.metadata_first: .*data\.frames=1"),
        ({"num_layers": 1}, r"model\.encoder\.num_layers: 1 .*data\.frames=1"),
        ({"lift": "lss", "sight": SightHead(16)}, r"model/sight: .*16.*lift\.stride=4"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_what_does_not_go_together_is_refused(settings, message):
    with pytest.raises(UserError, match=f"^{message}"):
        build_network(**settings)


@EACH_LIFT
def test_bfloat16_autocast_stays_close_gives_float32_and_trains(batch, lift):
    network = build_network(lift=lift).eval()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = network(batch)
    plain = network(batch)
    assert (mixed.dtype, mixed.shape) == (torch.float32, (2, 9, *GRID.shape))
    assert (mixed - plain).abs().mean() < 0.05 * plain.std()

    with torch.autocast("cpu", dtype=torch.bfloat16):
        require_finite_step(network.train(), batch)


@pytest.mark.parametrize("lift", ["deformable", "bilinear"])
def test_what_is_added_to_the_pillars_begins_about_as_large_as_they_are(batch, lift):
    """Otherwise training first learns what can be known without image and measurements."""
    network, sizes = build_network(lift=lift), []
    added = [layer.lift for layer in (*network.encoder.frame_layers, network.encoder.last_layer)]
    for module in (*added, network.metadata):
        module.register_forward_hook(lambda _, __, out: sizes.append(out[out != 0].std().item()))
    with torch.no_grad():
        network.eval()(batch)
    assert len(sizes) > len(added)
    assert 0.4 < min(sizes) <= max(sizes) < 3


@pytest.mark.slow
def test_the_papers_size_runs_forward():
    grid = VoxelGrid()
    encoder = PillarEncoder(grid, build_lift("deformable", num_heads=8))
    network = SkyOcc(ResNet(50), encoder, PillarDecoder(grid)).eval()
    with torch.no_grad():
        logits = network(build_batch(1, 2, grid, (800, 448)))
    assert logits.shape == (1, 9, 100, 100, 60)
    assert logits.isfinite().all()
