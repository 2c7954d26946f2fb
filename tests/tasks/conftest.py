"""A trained run of the full model, made once for all tasks that need a checkpoint."""

import pytest

from src.tasks.fit import fit
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """The words of a run of four epochs on the synthetic dataset: it predicts more than free."""
    words = mini_overrides(
        tmp_path_factory.mktemp("trained"),
        *("+experiment=skyocc", "trainer.accelerator=cpu", "trainer.max_epochs=4"),
        *("data.frames=2", "model.encoder.num_layers=2"),  # so that there is a history
    )
    write_dataset(compose_config(*words))
    fit(compose_config(*words))
    return words
