import pytest

from src.data.clip import Clip
from tests.models.synthetic import build_batch, build_network
from tests.synthetic import write_clip


@pytest.fixture
def network():
    return build_network()


@pytest.fixture
def batch():
    return build_batch()


@pytest.fixture(scope="session")
def clips(tmp_path_factory):
    """Two clips of 5 Hz: at 0.4 s, two frames a history step."""
    folder = tmp_path_factory.mktemp("clips")
    for seed, name in enumerate(("a", "b")):
        write_clip(folder / "town" / name, capture_hz=5, seed=seed)
    return {f"town/{name}": Clip(folder / "town" / name) for name in ("a", "b")}
