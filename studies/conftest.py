"""The fixtures of the project's tests that the studies' tests use, too."""

from tests.conftest import made_once, mini_config, mini_dataset, mini_sim  # noqa: F401
from tests.data.conftest import clips  # noqa: F401
from tests.metrics.conftest import four_classes, grid, random_batch  # noqa: F401
from tests.tasks.conftest import trained  # noqa: F401
