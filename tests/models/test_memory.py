"""Training along streams: what steps leave behind is the next ones' history."""

import pytest
import torch

from src.data.batches import StreamBatches
from src.data.dataset import OccupancyDataset
from src.geometry import VoxelGrid
from src.models.history import PillarMemory
from tests.models.synthetic import build_network

GRID = VoxelGrid(shape=(25, 25, 15))


def collated(samples):
    return {
        key: torch.stack([sample[key] for sample in samples])
        for key, value in samples[0].items()
        if isinstance(value, torch.Tensor)
    }


@pytest.mark.parametrize("history", ["queue", "recursive"])
def test_with_weights_that_stand_still_the_memory_holds_what_the_queue_computes(clips, history):
    """Each place at another point of its run, one of them at its beginning."""
    samples = [(clip, frame) for clip in clips for frame in range(8)]
    light, whole = (OccupancyDataset(clips, samples, 4, 0.2, images=i) for i in (False, True))
    network = build_network(grid=GRID, history=history).eval()
    memory = PillarMemory(3 if history == "queue" else 1)
    reached = set()
    for keys in StreamBatches(samples, 1, 4, 2, seed=0, mirror=True):
        batch, queue = (collated([data[key] for key in keys]) for data in (light, whole))
        with torch.no_grad():
            logits, left_behind, _ = network.step(batch, memory.history(batch))
            memory.keep(left_behind)
            torch.testing.assert_close(logits, network(queue), atol=1e-4, rtol=1e-4)
        reached |= {key.past for key in keys}
    assert reached == {0, 1, 2, 3}


def test_it_keeps_its_length_without_graph_and_notices_a_step_that_was_never_taken():
    memory = PillarMemory(2)
    valid = torch.tensor([[True, True, True, True]])
    window = {"history_valid": valid, "occ_from_past_occ": torch.eye(4).expand(1, 4, 4, 4)}
    for value in range(4):
        memory.keep(torch.full((1, 5, 3), float(value), requires_grad=True) * 1)
    history = memory.history(window)
    assert not history.pillars.requires_grad
    assert history.pillars[0, :, 0, 0].tolist() == [2.0, 3.0]
    assert history.valid.shape == (1, 2)

    memory.clear()
    with pytest.raises(RuntimeError, match="never taken"):
        memory.history(window)
    assert memory.history({**window, "history_valid": valid & False}) is None
