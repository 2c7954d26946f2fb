"""Training and flying on a simulated GPU: nothing is left behind on the CPU."""

import pytest
import torch
from torch.optim import AdamW

from src.metrics import OccupancyScores
from src.models.history import PillarMemory
from src.models.module import OccupancyModule
from src.models.stream import SkyOccStream
from src.parallax import Parallax
from src.tasks.export import made_up_flight
from tests.models.synthetic import (
    BINS,
    GRID,
    LIFTS,
    VOLUME,
    build_batch,
    build_loss,
    build_network,
)
from tests.simulated_cuda import CUDA, SimulatedCuda, simulated_cuda

pytestmark = pytest.mark.filterwarnings("ignore:.*self.log:UserWarning", "ignore:.*CUDA is not")
MOST_WAITS = {"deformable": 9, "bilinear": 9, "lss": 19}
"""What is seen, what exists and what is present depends on the data, and is asked for."""
SIM = {
    "image": {"width": 96, "height": 64, "hfov_deg": 90.0},
    "camera": {"position_m": [0.1, 0.0, 0.0], "pitch_deg": 0.0},
}


def build_module(loss, order="shuffled", **network):
    network = build_network(**network)
    memory = PillarMemory(network.past_frames) if order == "streams" else None
    optimizer = {"rule": AdamW, "lr": 1e-3, "weight_decay": 0.01}
    return OccupancyModule(
        network, loss, lambda: OccupancyScores(GRID), optimizer, torch.nn.Identity(), memory
    )


def moved(batch, device):
    return {key: value.to(device) for key, value in batch.items()}


def stepped(module, batch):
    """The loss of a whole training step, and the parameters after it."""
    batch = {**batch, "clip": ["a", "b"], "frame": [0, 1]}
    if module.memory is not None:
        # Before this step of a stream there was one more.
        none, one = (torch.arange(4) > 3 - past for past in (0, 1))
        valid = batch["history_valid"]
        module.training_step({**batch, "history_valid": valid & none.to(valid.device)}, 0)
        batch["history_valid"] = valid & one.to(valid.device)
    optimizer = AdamW(module.network.parameters(), lr=1e-3)
    total = module.training_step(batch, 0)
    total.backward()
    torch.nn.utils.clip_grad_norm_(module.network.parameters(), 5.0)
    optimizer.step()
    return total, list(module.network.parameters())


def step_on(device, **settings):
    """A training step on the CPU, or on the simulated device with what the host waited for."""
    weights = torch.rand(9, generator=torch.Generator().manual_seed(0))
    module, batch = build_module(build_loss(weights), **settings), build_batch()
    if device == "cpu":
        return *stepped(module, batch), None
    with simulated_cuda() as waits:
        module.to(CUDA)
        return *stepped(module, moved(batch, CUDA)), waits.copy()


@pytest.mark.parametrize(
    "settings",
    [
        *({"lift": lift} for lift in LIFTS),
        *({"lift": lift, "history": "recursive", "volume": VOLUME} for lift in LIFTS),
        *({"lift": "deformable", **way} for way in ({"checkpointing": True}, {"order": "streams"})),
        {"lift": "deformable", "volume": VOLUME, "parallax": Parallax([0.2], bins=BINS)},
    ],
)
def test_a_training_step_is_that_of_the_cpu(settings):
    expected, parameters, _ = step_on("cpu", **settings)
    total, on_device, waits = step_on("cuda:0", **settings)
    assert isinstance(total, SimulatedCuda)
    assert total.inner.equal(expected)
    assert all(a.inner.equal(b) for a, b in zip(on_device, parameters))
    if settings.keys() <= {"lift", "history", "volume"}:
        assert 0 < waits.total() <= MOST_WAITS[settings["lift"]]


@pytest.mark.parametrize("parallax", [None, Parallax([0.2], bins=BINS)])
def test_a_stream_flies_on_the_device(parallax):
    frames = made_up_flight(SIM, 5, 0.2)
    stream = SkyOccStream(build_network(parallax=parallax), 0.2)
    expected = [stream(frame) for frame in frames]
    with simulated_cuda():
        stream = SkyOccStream(build_network(parallax=parallax).to(CUDA), 0.2)
        logits = [stream(frame) for frame in frames]
    assert all(a.inner.equal(b) for a, b in zip(logits, expected))


def test_a_tensor_that_is_no_buffer_is_noticed():
    module = build_module(build_loss(None, 0.0), volume=VOLUME)
    ground = module.network.ground
    ground.z_m = ground._buffers.pop("z_m")
    with simulated_cuda(), pytest.raises(RuntimeError, match="found cuda:0 and cpu"):
        stepped(module.to(CUDA), moved(build_batch(), CUDA))
