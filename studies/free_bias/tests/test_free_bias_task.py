"""task=free_bias on a trained checkpoint, as a user calls it."""

import pandas as pd
import pytest

from src.errors import UserError
from src.results.counts import Counts
from src.results.files import read_results
from studies.free_bias.task import free_bias
from tests.synthetic import compose_config


def scored(cfg, bias, name="skyocc"):
    """KAR-mIoU on validation by bias, and the counts of the test split."""
    free_bias(cfg, bias)
    folder = f"{cfg.paths.run}/free_bias"
    table = pd.read_csv(f"{folder}/free_bias.csv").set_index("bias")["val/kar_miou"]
    return table, Counts.read(f"{folder}/tallies/{name}.npz")


@pytest.mark.slow
def test_no_bias_is_the_run_and_much_of_it_is_all_free_or_all_occupied(trained, capsys):
    cfg = compose_config(*trained, "ckpt_path=best")
    _, counts = scored(cfg, [0.0])
    results = read_results(f"{cfg.paths.run}/results.csv")
    ours = results[(results["experiment"] == "skyocc") & (results["split"] == "test")].iloc[0]
    own = float(counts.scores("occupancy")["kar_miou"])
    assert own == pytest.approx(ours["kar_miou"], abs=1e-7)
    assert counts.protocol.digest == ours["protocol"]

    for bias, free in ((1e4, 1.0), (-1e4, 0.0)):
        _, counts = scored(cfg, [bias])
        predicted = counts.tables["occupancy"]["count"].sum((0, 1)).double()
        assert float(predicted[-1] / predicted.sum()) == free


@pytest.mark.slow
def test_validation_chooses_and_the_smallest_of_equals_is_taken(trained, capsys):
    cfg = compose_config(*trained, "ckpt_path=best")
    curve, counts = scored(cfg, [-1.0, 0.0, 1.0, 1e4])
    assert curve[1e4] == 0
    alone, expected = scored(cfg, [float(curve.idxmax())])
    assert alone.iloc[0] == curve.max()
    assert counts.scores("occupancy")["kar_miou"] == expected.scores("occupancy")["kar_miou"]

    capsys.readouterr()
    scored(cfg, [2e4, 1e4])
    assert "free +10000:" in capsys.readouterr().out


@pytest.mark.slow
def test_what_cannot_be_scored_is_refused(trained):
    with pytest.raises(UserError, match="ckpt_path: task=free_bias needs a checkpoint"):
        free_bias(compose_config(*trained), [0.0])
    for wrong in ([], [float("nan")]):
        with pytest.raises(UserError, match=r"task\.bias: .*one finite number"):
            free_bias(compose_config(*trained, "ckpt_path=best"), wrong)
