"""What the runs of a report share, and what they do not."""

import pytest
from omegaconf import OmegaConf

from src.report.ladder import PAPER, ladder_named
from src.report.shared_settings import (
    FACTORS,
    differing,
    factors_of,
    marks_of,
    settings_table,
    shown_settings,
    surprises,
)
from src.results.runs import read_run
from tests.results.scored import WEIGHTS, write_run
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
    ends = [each for each in runs if each.experiment in ("baseline", "skyocc")]
    table = settings_table("k", "t", shown_settings(ends))
    assert table.columns == ["baseline", "skyocc"]
    assert table.rows[:4] == [
        ("model.encoder.projection", ["level", "attitude"]),
        ("loss.class_weights", ["null", "safety_weights(max_ratio=4.0)"]),
        ("loss.lovasz_weight", ["0.0", "1.0"]),
        ("seed", ["0, 1", "0, 1"]),
    ]
    assert ("optimizer.rule._target_", ["torch.optim.AdamW"] * 2) in table.rows
    assert "trainer.limit_train_batches" not in dict(table.rows), "none of them has it"


def test_the_composed_ladder_is_clean(run):
    """The projection stands in four places, of which three follow the factor: they were alarms."""
    runs = []
    for name in PAPER.names:
        cfg = compose_config("scale=tiny", f"+experiment={name}")
        composed = OmegaConf.to_container(cfg, resolve=True)
        changes = {key: composed[key] for key in ("model", "data", "loss", "suite")}
        runs.append(run(name, **changes))
    assert surprises(runs) == {}


def test_long_values_are_compared_to_their_end_and_told_short(run):
    place = "a/place/of/many/words/" * 5
    runs = [
        run(name, model__weights=f"{place}encoder-{end}.pth")
        for name, end in (("baseline", "a"), ("skyocc", "b"))
    ]
    ((setting, values),) = settings_table("k", "t", surprises(runs)).rows
    assert setting == "model.weights"
    assert [value[-13:] for value in values] == ["encoder-a.pth", "encoder-b.pth"]
    assert all(value.startswith("a/place/") and len(value) <= 60 for value in values)


MORE = {"loss__class_weights": {**WEIGHTS, "max_ratio": 8.0}}
LEVEL, LR = {"model__encoder__projection": "level"}, {"optimizer__lr": 0.01}
BF16 = {"facts": {"precision": "bf16-mixed"}}
UNCLEAN = {
    "a setting beside the factors": (
        {"baseline": {}, "skyocc": LR},
        {"optimizer.lr": {"baseline": ["0.002"], "skyocc": ["0.01"]}},
    ),
    # The first one has no weights at all, so it differs from both in the whole key.
    "a difference that only two later rungs show": (
        {"baseline": {}, "weights": {}, "skyocc": MORE},
        {"loss.class_weights.max_ratio": dict(baseline=["null"], weights=["4.0"], skyocc=["8.0"])},
    ),
    "a rung that is not what its name says": (
        {"baseline": {}, "skyocc": LEVEL},
        {"model.encoder.projection": {"baseline": ["level"], "skyocc": ["level"]}},
    ),
    "another precision under the same configuration": (
        {"baseline": {}, "mine": BF16},
        {"precision": {"baseline": ["32-true"], "mine": ["bf16-mixed"]}},
    ),
    "a rung of one's own may differ": ({"weights": {}, "skyocc": {}, "mine": LR}, {}),
    "a rung of the paper may not": (
        {"attitude": LR, "weights": {}, "mine": {}},
        {"optimizer.lr": {"attitude": ["0.01"], "weights": ["0.002"], "mine": ["0.002"]}},
    ),
}


@pytest.mark.parametrize("case", UNCLEAN)
def test_what_makes_a_comparison_unclean_is_told(run, case):
    made, told = UNCLEAN[case]
    runs = [run(name, 0, **changes) for name, changes in made.items()]
    assert surprises(runs, ladder_named(list(made) if "mine" in made else [])) == told


def test_seeds_of_a_rung_that_differ_in_a_factor_are_told(run):
    runs = [run("skyocc", 0), run("skyocc", 1, loss__lovasz_weight=0.0), run("weights", 0, **LEVEL)]
    assert surprises(runs[:2]) == {"loss.lovasz_weight": {"skyocc": ["1.0", "0.0"]}}
    assert marks_of(runs) == {"skyocc": ["✓", "✓", "✗/✓"], "weights": ["✗", "✓", "✗"]}
