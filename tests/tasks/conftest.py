"""A trained run of the full model, made once for all tasks that need a checkpoint."""

import shutil
from pathlib import Path

import pytest

from src.tasks import evaluate
from src.tasks.fit import fit
from tests.synthetic import compose_config, mini_overrides, write_dataset

WORDS = (
    *("+experiment=skyocc", "trainer.accelerator=cpu", "trainer.max_epochs=4"),
    *("data.frames=2", "model.encoder.num_layers=2"),  # so that there is a history
)


@pytest.fixture(scope="session")
def trained(made_once, tmp_path_factory):
    """The words of a run of four epochs on the synthetic dataset: it predicts more than free.

    The run is a copy, in which tasks may write.
    """

    def train(folder):
        cfg = compose_config(*mini_overrides(folder, *WORDS))
        write_dataset(cfg)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(evaluate, "SHOWN_FRAMES", 1)
            fit(cfg)

    made = made_once("trained", train)
    runs = shutil.copytree(made / "runs", tmp_path_factory.mktemp("trained") / "runs")
    return [*mini_overrides(made, *WORDS), f"paths.runs={runs}"]


@pytest.fixture(scope="session")
def checkpoint(trained):
    """The best checkpoint of that run."""
    return Path(compose_config(*trained).paths.run) / "checkpoints/best.ckpt"
