"""What the runs of a report share, and what they do not."""

import pytest
from omegaconf import OmegaConf

from src.report.ladder import PAPER, ladder_named
from src.report.shared_settings import (
    KEYS,
    code_lines,
    differing,
    factors_of,
    marks_of,
    other_experiments,
    statement,
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
    wrong = [] if weight else ["skyocc seed 0: loss.terms.lovasz.weight is not what"]
    assert [line[: len(wrong[0])] for line in surprises([mine])] == wrong
    other = run("weights", loss={"terms": {"cross_entropy": terms["cross_entropy"]}})
    if weight:
        assert surprises([other, mine]) == []


def test_a_clean_ladder_shares_all_but_its_factors_and_the_seed(run):
    runs = [run(name, seed) for name in PAPER.names for seed in (0, 1)]
    assert list(differing(runs)) == [*KEYS["factors"].values(), "seed"]
    assert surprises(runs) == []
    said = statement(runs)
    assert said.startswith(
        "All 8 runs of the ladder share every setting but: model.encoder.projection, "
        "loss.class_weights, loss.lovasz_weight, seed. Shared: 8 epochs, optimizer "
        "torch.optim.AdamW, learning rate 0.002, weight decay 0.01, warm-up over 0.05 of the steps "
        "and a cosine to zero, batches of 8, devices: 1, accumulated batches: 1, shuffled data "
        "order, mirror true, 4 frames a prediction, precision 32-true."
    )
    assert "Runs of one seed see the same frames in the same order, mirrored alike." in said
    assert "No rung has a setting of its own beside its factors." in said


@pytest.mark.parametrize(
    ("limit", "said"), [(0.25, "each of 0.25 of the frames"), (50, "each of 50 batches")]
)
def test_what_limits_an_epoch_is_a_share_of_the_frames_or_a_number_of_batches(run, limit, said):
    assert said in statement([run("baseline", trainer__limit_train_batches=limit)])


def test_long_values_are_compared_to_their_end_and_told_short(run):
    place = "a/place/of/many/words/" * 5
    runs = [
        run("baseline", model__weights=f"{place}encoder-a.pth"),
        run("skyocc", model__weights=f"{place}encoder-b.pth"),
    ]
    (line,) = surprises(runs)
    assert line.startswith("the rungs differ in model.weights: baseline a/place/")
    assert "encoder-a.pth; skyocc a/place/" in line
    assert len(line) < 200
    assert "of its own" not in statement(runs)


def test_the_values_of_what_differs_are_told_by_rung(run):
    runs = [run(name, seed) for name in ("baseline", "skyocc") for seed in (0, 1)]
    assert differing(runs) == {
        "model.encoder.projection": {"baseline": ["level"], "skyocc": ["attitude"]},
        "loss.class_weights": {"baseline": ["null"], "skyocc": ["safety_weights(max_ratio=4.0)"]},
        "loss.lovasz_weight": {"baseline": ["0.0"], "skyocc": ["1.0"]},
        "seed": {"baseline": ["0", "1"], "skyocc": ["0", "1"]},
    }


def test_a_setting_beside_the_factors_is_no_clean_comparison(run):
    runs = [run("baseline", 0), run("skyocc", 0, optimizer__lr=0.01, trainer__max_epochs=9)]
    assert surprises(runs) == [
        "the rungs differ in optimizer.lr: baseline 0.002; skyocc 0.01",
        "the rungs differ in trainer.max_epochs: baseline 8; skyocc 9",
    ]
    said = statement(runs)
    assert "optimizer.lr, trainer.max_epochs." in said
    assert not [words for words in ("learning rate", "8 epochs", "of its own") if words in said]


@pytest.mark.parametrize(
    ("same", "changes", "of_both"),
    [
        (True, {"optimizer__lr": 0.01}, {}),
        (False, {"data__order": "streams"}, {}),
        (False, {"trainer__max_epochs": 9}, {}),
        (False, {"code": "other"}, {}),
        (False, {}, {"code": None}),  # unknown code is not called the same
    ],
)
def test_the_same_frames_in_the_same_order_is_said_where_it_is_so(run, same, changes, of_both):
    runs = [run("baseline", **of_both), run("skyocc", **of_both, **changes)]
    assert ("see the same frames in the same order" in statement(runs)) is same


def test_an_own_rung_may_differ_and_is_told_by_how(run):
    runs = [run("weights"), run("skyocc"), run("mine", 0, optimizer__lr=0.01)]
    ladder = ladder_named(["weights", "skyocc", "mine"])
    assert surprises(runs, ladder) == []
    (line,) = other_experiments(runs, ladder)
    assert line == "mine is skyocc but for optimizer.lr = 0.01 (0.002)"
    said = statement(runs, ladder)
    assert said.startswith("All 3 runs of the ladder share every setting but: ")
    assert "of its own" not in said
    runs.append(run("attitude", 0, optimizer__lr=0.03))
    ladder = ladder_named(["attitude", *ladder.names])
    (line,) = surprises(runs, ladder)
    assert line.startswith("the rungs differ in optimizer.lr: ")


def test_of_a_ladder_without_any_of_the_papers_rungs_the_lowest_is_the_reference(run):
    runs = [run("one"), run("two", 0, optimizer__lr=0.01)]
    lines = other_experiments(runs, ladder_named(["one", "two"]))
    assert lines == ["two is one but for optimizer.lr = 0.01 (0.002)"]


def test_a_difference_that_only_two_later_rungs_show_is_found(run):
    """The first one has no weights at all, so it differs from both in the whole key."""
    more = {"_target_": "src.models.losses.safety_weights", "_partial_": True, "max_ratio": 8.0}
    runs = [run("baseline"), run("weights"), run("skyocc", loss__class_weights=more)]
    assert surprises(runs) == [
        "the rungs differ in loss.class_weights.max_ratio: baseline null; weights 4.0; skyocc 8.0"
    ]


def test_a_rung_that_is_not_what_its_name_says_is_told(run):
    runs = [run("baseline"), run("skyocc", 0, model__encoder__projection="level")]
    assert surprises(runs) == [
        "skyocc seed 0: model.encoder.projection is not what the rung's name says"
    ]
    assert marks_of(runs)["skyocc"] == ["✗", "✓", "✓"]


def test_seeds_of_a_rung_that_differ_in_a_factor_are_told(run):
    runs = [run("skyocc", 0), run("skyocc", 1, loss__lovasz_weight=0.5)]
    (line,) = surprises(runs)
    assert line == "seeds of one rung differ in loss.lovasz_weight: skyocc 1.0 or 0.5"
    runs.append(run("skyocc", 2, loss__lovasz_weight=0.0))
    assert marks_of(runs)["skyocc"] == ["✓", "✓", "✗/✓"]


def test_another_precision_is_told_though_the_configuration_is_the_same(run):
    runs = [run("baseline"), run("skyocc", facts={"precision": "bf16-mixed"})]
    (line,) = surprises(runs)
    assert line.endswith("precision: 32-true (baseline seed 0); bf16-mixed (skyocc seed 0)")
    assert "precision 32-true" not in statement(runs)


def test_one_run_shares_with_none(run):
    said = statement([run("skyocc")])
    assert said.startswith("There is one run of the ladder, with 8 epochs, optimizer torch")
    assert "of its own" not in said


def test_runs_that_are_no_rungs_are_compared_too(run):
    said = statement([run("queue"), run("streams", data__order="streams")])
    assert said.startswith("All 2 runs share every setting but: data.order. Shared: 8 epochs")
    assert "rung" not in said


def test_other_experiments_are_told_by_the_rung_that_they_are_nearest_to(run):
    runs = [
        *(run("baseline", 0), run("skyocc", 0)),
        run("streams", 1, data__order="streams"),
        run("twin", 0),
    ]
    assert other_experiments(runs) == [
        "streams is skyocc but for data.order = streams (shuffled)",
        "twin is skyocc but for its name",
    ]
    assert other_experiments(runs[2:]) == []


def test_code_is_told_where_it_is_not_one_and_known(run):
    one, other = run("baseline", 0), run("baseline", 1, code="0ther")
    assert code_lines([one]) == []
    assert code_lines([one, other]) == [
        "the runs were trained by different code: code c0de (baseline seed 0); "
        "code 0ther (baseline seed 1)"
    ]
    (line,) = code_lines([run("baseline", 2, code=None), run("baseline", 3, code=None)])
    assert line.startswith("unknown code: ")
    assert line.endswith("the commits abc")
