import shutil

import pytest

from src.report import animation
from studies.card.page import write_card
from studies.card.statistics import statistics_of


@pytest.fixture(scope="session")
def root(mini_dataset, tmp_path_factory):
    """A copy of the small dataset with its card, whose animation has two frames."""
    root = tmp_path_factory.mktemp("card") / mini_dataset.name
    shutil.copytree(mini_dataset, root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(animation, "SECONDS", 0.8)
        write_card(root)
    return root


@pytest.fixture(scope="session")
def statistics(mini_dataset):
    return statistics_of(mini_dataset)
