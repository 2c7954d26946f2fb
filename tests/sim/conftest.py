"""Fixtures that several tests of the simulator share."""

import pytest

from src.errors import UserError
from src.sim.renderer import require_renderer


@pytest.fixture(scope="session")
def needs_egl():
    try:
        require_renderer("egl")
    except UserError as error:
        pytest.skip(str(error))
