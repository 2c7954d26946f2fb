import pytest

from tests.models.synthetic import build_batch, build_network


@pytest.fixture
def network():
    return build_network()


@pytest.fixture
def batch():
    return build_batch()
