"""What the runs of a report share, and what they do not."""

import pytest
from omegaconf import OmegaConf

from src.report.ladder import PAPER, ladder_named
from src.report.shared_settings import (
    FACTORS,
    differing,
    factors_of,
    marks_of,
    others_table,
    settings_table,
    shared_table,
    surprises,
)
from src.results.runs import read_run
from tests.results.scored import write_run
from tests.synthetic import compose_config


@pytest.fixture
def run(tmp_path):
    """``run(experiment, seed, ...)``: a scored run with these changes."""
    return lambda *words, **changes: read_run(write_run(tmp_path, *words, **changes))


@pytest.mark.parametrize("experiment", PAPER.names)
def test_the_factors_are_read_from_what_an_experiment_composes(experiment):
    cfg = compose_config("scale=tiny", f"+experiment={experiment}")
    config = OmegaConf.to_container(cfg, resolve=True)
    assert factors_of(config) == PAPER.rungs[experiment].factors
    assert config["name"] == experiment


@pytest.mark.parametrize("weight", [None, 0.0, 1.0])
def test_the_factors_are_read_from_terms_of_the_loss_too(run, weight):
    lovasz = {} if weight is None else {"lovasz": {"weight": weight}}
    terms = {"cross_entropy": {"class_weights": {"max_ratio": 4.0}}, **lovasz}
    mine = run("skyocc", loss={"terms": terms})
    assert factors_of(mine.config) == (True, True, bool(weight))
    assert list(surprises([mine])) == ([] if weight else ["loss.terms.lovasz.weight"])
    other = run("weights", loss={"terms": {"cross_entropy": terms["cross_entropy"]}})
    if weight:
        assert surprises([other, mine]) == {}


def test_a_clean_ladder_shares_all_but_its_factors_and_the_seed(run):
    runs = [run(name, seed) for name in PAPER.names for seed in (0, 1)]
    assert list(differing(runs)) == [*FACTORS.values(), "seed"]
    assert surprises(runs) == {}
    assert {setting: value for setting, (value,) in shared_table(runs).rows} == {
        **{"trainer.max_epochs": "8", "trainer.devices": "1"},
        **{"trainer.accumulate_grad_batches": "1", "optimizer.rule._target_": "torch.optim.AdamW"},
        **{"optimizer.lr": "0.002", "optimizer.weight_decay": "0.01", "optimizer.warmup": "0.05"},
        **{"data.batch_size": "8", "data.order": "shuffled", "data.mirror": "true"},
        "data.frames": "4",
    }


def test_what_differs_is_not_called_shared(run):
    runs = [run("baseline"), run("skyocc", 0, trainer__max_epochs=9, data__order="streams")]
    assert not {"trainer.max_epochs", "data.order"} & {name for name, _ in shared_table(runs).rows}


def test_long_values_are_compared_to_their_end_and_told_short(run):
    place = "a/place/of/many/words/" * 5
    runs = [
        run("baseline", model__weights=f"{place}encoder-a.pth"),
        run("skyocc", model__weights=f"{place}encoder-b.pth"),
    ]
    ((setting, values),) = settings_table("k", "t", surprises(runs)).rows
    assert setting == "model.weights"
    assert [value[-13:] for value in values] == ["encoder-a.pth", "encoder-b.pth"]
    assert all(value.startswith("a/place/") and len(value) <= 60 for value in values)


def test_the_values_of_what_differs_are_told_by_rung(run):
    runs = [run(name, seed) for name in ("baseline", "skyocc") for seed in (0, 1)]
    assert differing(runs) == {
        "model.encoder.projection": {"baseline": ["level"], "skyocc": ["attitude"]},
        "loss.class_weights": {"baseline": ["null"], "skyocc": ["safety_weights(max_ratio=4.0)"]},
        "loss.lovasz_weight": {"baseline": ["0.0"], "skyocc": ["1.0"]},
        "seed": {"baseline": ["0", "1"], "skyocc": ["0", "1"]},
    }
    table = settings_table("k", "t", differing(runs))
    assert table.columns == ["baseline", "skyocc"]
    assert table.rows[-1] == ("seed", ["0, 1", "0, 1"])


def test_a_setting_beside_the_factors_is_no_clean_comparison(run):
    runs = [run("baseline", 0), run("skyocc", 0, optimizer__lr=0.01, trainer__max_epochs=9)]
    assert surprises(runs) == {
        "optimizer.lr": {"baseline": ["0.002"], "skyocc": ["0.01"]},
        "trainer.max_epochs": {"baseline": ["8"], "skyocc": ["9"]},
    }


def test_an_own_rung_may_differ_and_is_told_by_how(run):
    runs = [run("weights"), run("skyocc"), run("mine", 0, optimizer__lr=0.01)]
    ladder = ladder_named(["weights", "skyocc", "mine"])
    assert surprises(runs, ladder) == {}
    assert others_table(runs, ladder).rows == [
        ("mine", ["skyocc", "optimizer.lr", "0.01", "0.002"])
    ]
    runs.append(run("attitude", 0, optimizer__lr=0.03))
    ladder = ladder_named(["attitude", *ladder.names])
    assert list(surprises(runs, ladder)) == ["optimizer.lr"]


def test_of_a_ladder_without_any_of_the_papers_rungs_the_lowest_is_the_reference(run):
    runs = [run("one"), run("two", 0, optimizer__lr=0.01)]
    table = others_table(runs, ladder_named(["one", "two"]))
    assert table.rows == [("two", ["one", "optimizer.lr", "0.01", "0.002"])]


def test_a_difference_that_only_two_later_rungs_show_is_found(run):
    """The first one has no weights at all, so it differs from both in the whole key."""
    more = {"_target_": "src.models.losses.safety_weights", "_partial_": True, "max_ratio": 8.0}
    runs = [run("baseline"), run("weights"), run("skyocc", loss__class_weights=more)]
    assert surprises(runs) == {
        "loss.class_weights.max_ratio": {
            **{"baseline": ["null"], "weights": ["4.0"], "skyocc": ["8.0"]}
        }
    }


def test_a_rung_that_is_not_what_its_name_says_is_told(run):
    runs = [run("baseline"), run("skyocc", 0, model__encoder__projection="level")]
    assert surprises(runs) == {
        "model.encoder.projection": {"baseline": ["level"], "skyocc": ["level"]}
    }
    assert marks_of(runs)["skyocc"] == ["✗", "✓", "✓"]


def test_seeds_of_a_rung_that_differ_in_a_factor_are_told(run):
    runs = [run("skyocc", 0), run("skyocc", 1, loss__lovasz_weight=0.5)]
    assert surprises(runs) == {"loss.lovasz_weight": {"skyocc": ["1.0", "0.5"]}}
    runs.append(run("skyocc", 2, loss__lovasz_weight=0.0))
    assert marks_of(runs)["skyocc"] == ["✓", "✓", "✗/✓"]


def test_another_precision_is_told_though_the_configuration_is_the_same(run):
    runs = [run("baseline"), run("mine", facts={"precision": "bf16-mixed"})]
    assert surprises(runs, ladder_named(["baseline", "mine"])) == {
        "precision": {"baseline": ["32-true"], "mine": ["bf16-mixed"]}
    }


def test_other_experiments_are_told_by_the_rung_that_they_are_nearest_to(run):
    runs = [
        *(run("baseline", 0), run("skyocc", 0)),
        run("streams", 1, data__order="streams"),
        run("twin", 0),
    ]
    assert others_table(runs).rows == [
        ("streams", ["skyocc", "data.order", "streams", "shuffled"]),
        ("twin", ["skyocc", "", "", ""]),
    ]
    assert others_table(runs[2:]).rows == []
