import pytest

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
