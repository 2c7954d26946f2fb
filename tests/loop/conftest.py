"""The front camera of the smallest scale."""

import pytest
from omegaconf import OmegaConf

from src.loop.camera import FrontCamera
from tests.synthetic import compose_config


@pytest.fixture(scope="module")
def camera():
    return FrontCamera(OmegaConf.to_container(compose_config("scale=tiny").sim, resolve=True))
