import pytest
import torch

from src.data.clip import Clip
from tests.synthetic import write_clip


@pytest.fixture(scope="session")
def clips(tmp_path_factory):
    """Two clips of the same scene by id, at 5 Hz."""
    root = tmp_path_factory.mktemp("clips")
    ids = ("downtown/clip00", "suburb/clip00")
    for seed, clip_id in enumerate(ids):
        write_clip(root / clip_id, capture_hz=5, seed=seed)
    return {clip_id: Clip(root / clip_id) for clip_id in ids}


def assert_same(sample, other):
    """Of samples or batches: every entry is the same to the last bit."""
    assert sample.keys() == other.keys()
    for key, value in sample.items():
        same = torch.equal(value, other[key]) if torch.is_tensor(value) else value == other[key]
        assert same, key
