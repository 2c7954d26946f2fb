"""Which settings the runs of a report share, and which not: read from their configurations."""

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations
from typing import TypeVar

from ..results.runs import UNKNOWN_CODE, ScoredRun, value_at
from ..run_folder import differences, shaping
from .ladder import PAPER, Ladder

SEED = "seed"
LIMIT = "each of {} of the frames"
# Keys of a run's configuration that a report names.
KEYS = {
    # The ladder's three factors, and where published runs have them.
    "factors": {
        "model.encoder.projection": "model.encoder.projection",
        "loss.terms.cross_entropy.class_weights": "loss.class_weights",
        "loss.terms.lovasz.weight": "loss.lovasz_weight",
    },
    # The words in which a shared setting is told, and its key.
    "shared": {
        "{} epochs": "trainer.max_epochs",
        LIMIT: "trainer.limit_train_batches",
        "optimizer {}": "optimizer.rule._target_",
        "learning rate {}": "optimizer.lr",
        "weight decay {}": "optimizer.weight_decay",
        "warm-up over {} of the steps and a cosine to zero": "optimizer.warmup",
        "batches of {}": "data.batch_size",
        "devices: {}": "trainer.devices",
        "accumulated batches: {}": "trainer.accumulate_grad_batches",
        "{} data order": "data.order",
        "mirror {}": "data.mirror",
        "{} frames a prediction": "data.frames",
    },
}
# Keys in which rungs may differ; a rung without the Lovász loss has nothing under its name.
FACTOR_KEYS = tuple(dict.fromkeys(chain(*KEYS["factors"].items(), ["loss.terms.lovasz"])))
# Beginnings of the keys that decide which frames a run sees, in which order and how often.
ORDERING = ("data.", "sim.", "trainer.")
# Letters of a value in a table or a sentence; values are compared as a whole.
LONGEST = 60

Values = dict[str, dict[str, list[str]]]
Value = TypeVar("Value")


def differing(runs: Sequence[ScoredRun]) -> Values:
    """Returns every key in which any two runs differ, with its values in each experiment.

    The factors come first and the seed last.
    """
    configs = [shaping(run.config) for run in runs]
    keys = {key for pair in combinations(configs, 2) for key, _, _ in differences(*pair)}
    order = {key: n for n, key in enumerate(FACTOR_KEYS)}

    table: Values = {}
    for key in sorted(keys, key=lambda key: (order.get(key, len(order)), key == SEED, key)):
        values = (_text(value_at(config, key)) for config in configs)
        table[key] = grouped(zip((run.experiment for run in runs), values))
    return table


def statement(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> str:
    """Says what runs share, and lists what they do not; of the ladder's runs, or of any others."""
    of_ladder = all(run.experiment in ladder for run in runs)
    noun = " of the ladder" if of_ladder else ""
    keys = list(differing(runs))
    shared = [
        _in_words(text, value_at(runs[0].config, key))
        for text, key in KEYS["shared"].items()
        if key not in keys and value_at(runs[0].config, key) is not None
    ]
    precisions = {run.row["precision"] for run in runs}
    shared += [f"precision {precision}" for precision in precisions if len(precisions) == 1]
    if len(runs) == 1:
        return f"There is one run{noun}, with {', '.join(shared)}."

    but = f" but: {', '.join(keys)}" if keys else ""
    text = f"All {len(runs)} runs{noun} share every setting{but}. Shared: {', '.join(shared)}."
    one_code = {run.code for run in runs} == {runs[0].code} != {UNKNOWN_CODE}
    if one_code and not any(key.startswith(ORDERING) for key in keys):
        text += " Runs of one seed see the same frames in the same order, mirrored alike."
    of_paper = of_ladder and all(ladder.rungs[run.experiment].factors for run in runs)
    if of_paper and not surprises(runs, ladder):
        text += (
            " No rung has a setting of its own beside its factors. Of trials that left no run here "
            "nothing is known."
        )
    return text


def surprises(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> list[str]:
    """Says what makes runs of the ladder more, or less, than a comparison of its three factors.

    A rung that the paper does not have may differ from the others in anything.
    """
    lines = []
    for key, by_experiment in differing(runs).items():
        texts = {name: " or ".join(map(shortened, of)) for name, of in by_experiment.items()}
        values = "; ".join(f"{name} {text}" for name, text in texts.items())
        of_paper = [of for name, of in by_experiment.items() if ladder.rungs[name].factors]
        if key not in (*FACTOR_KEYS, SEED) and any(of != of_paper[0] for of in of_paper):
            lines.append(f"the rungs differ in {key}: {values}")
        elif key != SEED and any(len(of) > 1 for of in by_experiment.values()):
            lines.append(f"seeds of one rung differ in {key}: {values}")

    for run in runs:
        has, required = factors_of(run.config), ladder.rungs[run.experiment].factors
        if required and has != required:
            keys = zip(_factor_keys(run.config), has, required)
            wrong = ", ".join(key for key, one, other in keys if one != other)
            lines.append(f"{run}: {wrong} is not what the rung's name says")
    precisions = grouped((run.row["precision"], str(run)) for run in runs)
    if len(precisions) > 1:
        lines.append(f"they were computed in different precision: {listed(precisions)}")
    return lines


def other_experiments(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> list[str]:
    """Says of each experiment that is no rung of the paper which rung it is nearest to, and where
    it differs. Without any of the paper's rungs, the lowest rung is the one to differ from."""
    configs = {run.experiment: shaping(run.config) for run in reversed(runs)}
    present = [name for name in ladder.names if name in configs]
    rungs = [name for name in present if ladder.rungs[name].factors] or present[:1]

    lines = []
    for name in ladder.in_order(name for name in configs if name not in rungs):
        changes = {
            rung: [d for d in differences(configs[rung], configs[name]) if d[0] != SEED]
            for rung in rungs
        }
        if changes:
            nearest = min(changes, key=lambda rung: len(changes[rung]))
            but = "; ".join(
                f"{key} = {shortened(_text(new))} ({shortened(_text(old))})"
                for key, old, new in changes[nearest]
            )
            lines.append(f"{name} is {nearest} but for {but or 'its name'}")
    return lines


def code_lines(runs: Sequence[ScoredRun]) -> list[str]:
    """Says which code trained the runs, where it is not one and known."""
    codes = grouped((run.code, str(run)) for run in runs)
    if len(codes) > 1:
        return [f"the runs were trained by different code: {listed(codes)}"]
    if UNKNOWN_CODE in codes:
        commits = grouped((run.row["git_commit"] or "no commit", str(run)) for run in runs)
        return [
            "unknown code: the run folders do not record what src was when they were trained; "
            f"they name the commits {', '.join(commits)}"
        ]
    return []


def factors_of(config: Mapping) -> tuple[bool, bool, bool]:
    """Returns which of the ladder's factors a run's configuration has."""
    projection, weights, lovasz = (value_at(config, key) for key in _factor_keys(config))
    return projection == "attitude", weights is not None, bool(lovasz)


def _factor_keys(config: Mapping) -> Iterable[str]:
    """Returns the key of each factor in a run's configuration."""
    is_published = value_at(config, "loss.terms") is None
    return KEYS["factors"].values() if is_published else KEYS["factors"]


def marks_of(runs: Sequence[ScoredRun]) -> dict[str, list[str]]:
    """Returns check marks of the three factors of every rung, from its runs' configurations."""
    by_experiment = grouped((run.experiment, factors_of(run.config)) for run in runs)
    return {
        name: ["/".join("✗✓"[has] for has in sorted(set(kinds))) for kinds in zip(*factors)]
        for name, factors in by_experiment.items()
    }


def shortened(text: str) -> str:
    """Returns a value for a sentence: of a long one both ends, as paths differ in their last."""
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]}…{text[1 - half :]}"


def grouped(pairs: Iterable[tuple[str, Value]]) -> dict[str, list[Value]]:
    """Returns the values of each key, in their order and each once."""
    values: dict[str, dict[Value, None]] = {}
    for key, value in pairs:
        values.setdefault(key, {})[value] = None
    return {key: list(of_key) for key, of_key in values.items()}


def listed(values: Mapping[str, Sequence[str]]) -> str:
    """Returns every key, and in brackets its values."""
    return "; ".join(f"{key} ({', '.join(of_key)})" for key, of_key in values.items())


def _text(value: object) -> str:
    """Returns a value as one reads it: an object that is built from a class, as its call."""
    if isinstance(value, Mapping) and "_target_" in value:
        arguments = {key: one for key, one in value.items() if not key.startswith("_")}
        listed = ", ".join(f"{key}={_text(one)}" for key, one in arguments.items())
        return f"{value['_target_'].rpartition('.')[2]}({listed})"
    return value if isinstance(value, str) else json.dumps(value)


def _in_words(text: str, value: object) -> str:
    """Fills in the words of a setting. A limit is a share of the frames, or a number of batches."""
    if text == LIMIT and isinstance(value, int):
        return f"each of {value} batches"
    return text.format(shortened(_text(value)))
