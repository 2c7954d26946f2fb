"""Worker processes of flights."""

import os

import pytest

from src.errors import UserError
from src.tasks.fleet import Fleet


def test_a_worker_that_dies_is_told_in_one_line():
    with Fleet([{}], 1) as fleet, pytest.raises(UserError, match=r"a worker died .* kept: run it"):
        list(fleet._done([("a map", os._exit, (1,))]))
