"""Two processes that share a training: same gradients and same scores as one."""

import pandas as pd
import pytest
import torch

from src.results.files import read_results
from tests.sessions import python
from tests.synthetic import compose_config, mini_overrides, write_dataset

TWO = ("trainer.devices=2", "trainer.accelerator=cpu")
ONE = ("trainer.devices=1", "trainer.accelerator=cpu")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("processes")
    write_dataset(compose_config(*mini_overrides(folder)))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("order", ["shuffled", "streams"])
def test_two_processes_have_the_gradients_of_one_that_accumulates(folder, order):
    """Two batches of two processes are the same two batches of one process."""
    step = ("+trainer.max_steps=1", "+trainer.limit_val_batches=0", "data.batch_size=4")
    overrides = mini_overrides(folder, "+experiment=skyocc", *step, f"data.order={order}")
    if order == "streams":
        overrides += ["data.frames=2", "model.encoder.num_layers=2"]
    else:
        # A history would be computed with the statistics that the first of the two batches left.
        overrides.append("data.frames=1")
        alone = folder / "alone.pt"
        accumulated = (*ONE, "trainer.accumulate_grad_batches=2")
        python("-m", "tests.gradients_of_one_step", str(alone), *overrides, *accumulated)
        expected = torch.load(f"{alone}.0", weights_only=True)
    shared = folder / f"{order}.pt"
    python("-m", "tests.gradients_of_one_step", str(shared), *overrides, *TWO)
    ranks = [torch.load(f"{shared}.{rank}", weights_only=True) for rank in range(2)]

    assert all(gradient is not None for gradient in ranks[0].values())
    for name, gradient in ranks[0].items():
        assert gradient.equal(ranks[1][name]), f"{name} differs between the processes"
        if order == "shuffled":
            scale = expected[name].abs().max().item()
            torch.testing.assert_close(
                gradient, expected[name], atol=1e-5 * scale + 1e-9, rtol=1e-4, msg=name
            )


@pytest.mark.slow
def test_a_training_of_two_processes_is_scored_as_one_would_score_it(folder):
    overrides = ("+experiment=skyocc", *mini_overrides(folder), "data.batch_size=4")
    output = python("run.py", *overrides, *TWO).stdout
    assert output.count("frames to train") == 1, "one of them speaks"
    run = folder / "runs/tiny/skyocc/seed0"
    trained = read_results(run / "results.csv")
    python("run.py", *overrides, *ONE, "task=test", f"ckpt_path={run}/checkpoints/best.ckpt")
    alone = read_results(run / "test/results.csv")
    timed = ["seconds", "code_version"]
    pd.testing.assert_frame_equal(trained.drop(columns=timed), alone.drop(columns=timed))
    metrics = pd.read_csv(run / "metrics.csv")
    assert metrics["val/kar_miou"].notna().sum() == 2


@pytest.mark.slow
def test_a_sweep_of_such_trainings_does_one_after_the_other(folder):
    """Each starts a second process for its own overrides, not for those of the whole sweep."""
    overrides = ("-m", "+experiment=baseline", "seed=0,1", *mini_overrides(folder), *TWO)
    output = python("run.py", *overrides, "data.batch_size=4", "trainer.max_epochs=1").stdout
    assert output.splitlines()[-2:] == ["seed=0: finished", "seed=1: finished"]
    assert output.count("frames to train") == 2
