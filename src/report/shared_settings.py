"""The settings of the runs of a report, and those that make a comparison of its rungs unclean."""

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations
from typing import TypeVar

from ..dotted import differences, is_listed, value_at
from ..results.render import Table
from ..results.runs import ScoredRun
from ..run_folder import shaping
from .ladder import PAPER, Ladder

SEED, PRECISION = "seed", "precision"
METRICS = "suite.metrics"
# The ladder's three factors, and where published runs have them.
FACTORS = {
    "model.encoder.projection": "model.encoder.projection",
    "loss.terms.cross_entropy.class_weights": "loss.class_weights",
    "loss.terms.lovasz.weight": "loss.lovasz_weight",
}
# Where else the projection stands, which follows the factor.
FOLLOWERS = (
    *("data.parallax.projection", "model.evidence.projection"),
    "model.sight.parallax.projection",
)
# Keys whose values a report shows also where all runs share them.
SHOWN = (
    *("trainer.max_epochs", "trainer.limit_train_batches", "trainer.devices"),
    *("trainer.accumulate_grad_batches", "optimizer.rule._target_", "optimizer.lr"),
    *("optimizer.weight_decay", "optimizer.warmup", "data.batch_size", "data.order"),
    *("data.mirror", "data.frames"),
)
# Keys in which rungs may differ; a rung without the Lovász loss has nothing under its name.
FACTOR_KEYS = tuple(dict.fromkeys(chain(*FACTORS.items(), ["loss.terms.lovasz"], FOLLOWERS)))
# Letters of a value in a table; values are compared as a whole.
LONGEST = 60

Values = dict[str, dict[str, list[str]]]
Value = TypeVar("Value")


def differing(runs: Sequence[ScoredRun]) -> Values:
    """Returns every key in which any two runs differ, with its values in each experiment.

    The factors come first and the seed last.
    """
    configs = [shaping(run.config) for run in runs]
    keys = {key for pair in combinations(configs, 2) for key, _, _ in differences(*pair)}
    # A metric that only some of them have changes no score that the others have, too.
    metrics = [set(value_at(config, METRICS) or {}) for config in configs]
    extra = {name for name in set().union(*metrics) if any(name not in of for of in metrics)}
    keys = {key for key in keys if not is_listed(key, [f"{METRICS}.{name}" for name in extra])}
    order = {key: n for n, key in enumerate(FACTOR_KEYS)}
    ordered = sorted(keys, key=lambda key: (order.get(key, len(order)), key == SEED, key))
    return {key: _values(runs, key) for key in ordered}


def surprises(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> Values:
    """Returns the settings that make runs of the ladder more, or less, than a comparison of its
    three factors, with their values in each experiment."""
    wrong = {
        key
        for run in runs
        if (required := ladder.rungs[run.experiment].factors)
        for key, has, other in zip(_factor_keys(run.config), factors_of(run.config), required)
        if has != other
    }

    found = {}
    for key in dict.fromkeys((*sorted(wrong), *differing(runs), PRECISION)):
        of = _values(runs, key)
        # A rung that the paper does not have may differ in all but the precision.
        compared = [of[name] for name in of if key == PRECISION or ladder.rungs[name].factors]
        is_own = key not in FACTOR_KEYS and any(values != compared[0] for values in compared)
        is_uneven = any(len(values) > 1 for values in of.values())
        if key in wrong or (key != SEED and (is_own or is_uneven)):
            found[key] = of
    return found


def shown_settings(runs: Sequence[ScoredRun]) -> Values:
    """Returns the keys in which runs differ, and the settings of their schedule and data."""
    given = [key for key in SHOWN if any(value_at(run.config, key) is not None for run in runs)]
    return differing(runs) | {key: _values(runs, key) for key in given}


def settings_table(key: str, title: str, values: Values) -> Table:
    """Returns a table of settings, with the values of each experiment."""
    experiments = list(dict.fromkeys(name for of in values.values() for name in of))
    rows = [
        (setting, [", ".join(map(_shortened, of[name])) for name in experiments])
        for setting, of in values.items()
    ]
    return Table(key, title, "", experiments, rows, head="Setting")


def factors_of(config: Mapping) -> tuple[bool, bool, bool]:
    """Returns the factors of the ladder that a run's configuration has."""
    projection, weights, lovasz = (value_at(config, key) for key in _factor_keys(config))
    return projection == "attitude", weights is not None, bool(lovasz)


def _factor_keys(config: Mapping) -> Iterable[str]:
    """Returns the key of each factor in a run's configuration."""
    is_published = value_at(config, "loss.terms") is None
    return FACTORS.values() if is_published else FACTORS


def marks_of(runs: Sequence[ScoredRun]) -> dict[str, list[str]]:
    """Returns check marks of the three factors of every rung, from its runs' configurations."""
    by_experiment = grouped((run.experiment, factors_of(run.config)) for run in runs)
    return {
        name: ["/".join("✗✓"[has] for has in sorted(set(kinds))) for kinds in zip(*factors)]
        for name, factors in by_experiment.items()
    }


def grouped(pairs: Iterable[tuple[str, Value]]) -> dict[str, list[Value]]:
    """Returns the values of each key, in their order and each once."""
    values: dict[str, dict[Value, None]] = {}
    for key, value in pairs:
        values.setdefault(key, {})[value] = None
    return {key: list(of_key) for key, of_key in values.items()}


def listed(values: Mapping[str, Sequence[str]]) -> str:
    """Returns every key, and in brackets its values."""
    return "; ".join(f"{key} ({', '.join(of_key)})" for key, of_key in values.items())


def _values(runs: Sequence[ScoredRun], key: str) -> dict[str, list[str]]:
    """Returns the values of a setting in each experiment; the precision is that of the device."""
    if key == PRECISION:
        return grouped((run.experiment, run.row[PRECISION]) for run in runs)
    return grouped((run.experiment, _text(value_at(shaping(run.config), key))) for run in runs)


def _text(value: object) -> str:
    """Returns a value as one reads it: an object that is built from a class, as its call."""
    if isinstance(value, Mapping) and "_target_" in value:
        arguments = [f"{key}={_text(one)}" for key, one in value.items() if key[0] != "_"]
        return f"{value['_target_'].rpartition('.')[2]}({', '.join(arguments)})"
    return value if isinstance(value, str) else json.dumps(value)


def _shortened(text: str) -> str:
    """Returns a value for a table: of a long one both ends, as paths differ in their last."""
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]}…{text[1 - half :]}"
