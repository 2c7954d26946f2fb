"""Which settings the runs of a report share, and which not: read from their configurations."""

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

from ..run_folder import differences, shaping
from .ladder import FACTORS, PAPER, Ladder, factors_of, value_at
from .scored_runs import UNKNOWN_CODE, ScoredRun

SEED = "seed"
LIMIT = "each of {} of the frames"
SHARED = {
    "{} epochs": "trainer.max_epochs",
    LIMIT: "trainer.limit_train_batches",
    "AdamW at {}": "optimizer.lr",
    "weight decay {}": "optimizer.weight_decay",
    "warm-up over {} of the steps and a cosine to zero": "optimizer.warmup",
    "batches of {}": "data.batch_size",
    "devices: {}": "trainer.devices",
    "accumulated batches: {}": "trainer.accumulate_grad_batches",
    "{} data order": "data.order",
    "mirror {}": "data.mirror",
    "{} frames a prediction": "data.frames",
}
"""What is told of the settings that all runs share and have, and their keys."""
ORDERING = ("data.", "sim.", "trainer.")
"""Begin the keys that decide which frames a run sees, in which order and how often."""
LONGEST = 60
"""Letters of a value as it is shown; all of it is compared."""

Values = dict[str, dict[str, list[str]]]


def differing(runs: Sequence[ScoredRun]) -> Values:
    """Every key in which any two runs differ, with its values in each experiment."""
    configs = [shaping(run.config) for run in runs]
    keys = {key for pair in combinations(configs, 2) for key, _, _ in differences(*pair)}
    found: Values = {}
    for key in sorted(keys, key=_place):
        by_experiment = found.setdefault(key, {})
        for run, config in zip(runs, configs):
            values = by_experiment.setdefault(run.experiment, [])
            values += [text] if (text := _text(value_at(config, key))) not in values else []
    return found


def statement(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> str:
    """What runs share, and the list of what they do not; of the ladder's, or of any others."""
    of_ladder = all(run.experiment in ladder for run in runs)
    keys = list(differing(runs))
    told = [
        _told(text, value_at(runs[0].config, key))
        for text, key in SHARED.items()
        if key not in keys and value_at(runs[0].config, key) is not None
    ]
    precisions = {run.row["precision"] for run in runs}
    told += [f"precision {precision}" for precision in precisions if len(precisions) == 1]
    if len(runs) == 1:
        return f"There is one run{' of the ladder' * of_ladder}, with {', '.join(told)}."
    but = f" but: {', '.join(keys)}" if keys else ""
    said = f"All {len(runs)} runs{' of the ladder' * of_ladder} share every setting{but}. "
    said += f"Shared: {', '.join(told)}."
    one_code = {run.code for run in runs} == {runs[0].code} != {UNKNOWN_CODE}
    if one_code and not any(key.startswith(ORDERING) for key in keys):
        said += " Runs of one seed see the same frames in the same order, mirrored alike."
    known = of_ladder and all(ladder.rungs[run.experiment].factors for run in runs)
    if known and not surprises(runs, ladder):
        said += (
            " No rung has a setting of its own beside its factors. Of trials that left no run here "
            "nothing is known."
        )
    return said


def surprises(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> list[str]:
    """What makes runs of the ladder more, or less, than a comparison of its three factors.

    A rung that the paper does not have may differ from the others in anything.
    """
    found = []
    for key, by_experiment in differing(runs).items():
        of_paper = [v for name, v in by_experiment.items() if ladder.rungs[name].factors]
        if key not in (*FACTORS, SEED) and any(values != of_paper[0] for values in of_paper):
            found.append(f"the rungs differ in {key}: {_by_experiment(by_experiment)}")
        elif key != SEED and any(len(values) > 1 for values in by_experiment.values()):
            found.append(f"seeds of one rung differ in {key}: {_by_experiment(by_experiment)}")
    for run in runs:
        has, shall = factors_of(run.config), ladder.rungs[run.experiment].factors
        if shall and has != shall:
            wrong = [key for key, a, b in zip(FACTORS, has, shall) if a != b]
            found.append(f"{run}: {', '.join(wrong)} is not what the rung's name says")
    precisions = _grouped((run.row["precision"], run) for run in runs)
    if len(precisions) > 1:
        found.append(f"they were computed in different precision: {_lists(precisions)}")
    return found


def other_experiments(runs: Sequence[ScoredRun], ladder: Ladder = PAPER) -> list[str]:
    """Each experiment that is no rung of the paper: the rung that it is nearest to, and where it
    differs. Where none of the paper's is there, the lowest rung is what the others differ from."""
    configs = {run.experiment: shaping(run.config) for run in reversed(runs)}
    there = [name for name in ladder.names if name in configs]
    rungs = [name for name in there if ladder.rungs[name].factors] or there[:1]
    lines = []
    for name in ladder.in_order(name for name in configs if name not in rungs):
        found = {
            rung: [d for d in differences(configs[rung], configs[name]) if d[0] != SEED]
            for rung in rungs
        }
        if found:
            nearest = min(found, key=lambda rung: len(found[rung]))
            but = "; ".join(_changed(*one) for one in found[nearest])
            lines.append(f"{name} is {nearest} but for {but or 'its name'}")
    return lines


def _changed(key: str, old: object, new: object) -> str:
    return f"{key} = {shortened(_text(new))} ({shortened(_text(old))})"


def code_lines(runs: Sequence[ScoredRun]) -> list[str]:
    """Which code trained the runs, where it is not one and known."""
    codes = _grouped((run.code, run) for run in runs)
    if len(codes) > 1:
        return [f"the runs were trained by different code: {_lists(codes)}"]
    if UNKNOWN_CODE in codes:
        commits = _grouped((run.row["git_commit"] or "no commit", run) for run in runs)
        return [
            "unknown code: the run folders do not record what src was when they were trained; "
            f"they name the commits {', '.join(commits)}"
        ]
    return []


def marks_of(runs: Sequence[ScoredRun]) -> dict[str, tuple[str, ...]]:
    """Check marks of the three factors of every rung, from the configurations of its runs."""
    by_experiment: dict[str, set] = {}
    for run in runs:
        by_experiment.setdefault(run.experiment, set()).add(factors_of(run.config))
    return {
        name: tuple("/".join("✗✓"[has] for has in sorted(set(kinds))) for kinds in zip(*factors))
        for name, factors in by_experiment.items()
    }


def _place(key: str) -> tuple[int, bool, str]:
    """Where a key stands in a list: the factors first, the seed last."""
    return FACTORS.index(key) if key in FACTORS else len(FACTORS), key == SEED, key


def _grouped(pairs: Iterable[tuple[str, ScoredRun]]) -> dict[str, list[str]]:
    grouped: dict[str, list[str]] = {}
    for key, run in pairs:
        grouped.setdefault(key, []).append(str(run))
    return grouped


def _lists(grouped: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{key} ({', '.join(runs)})" for key, runs in grouped.items())


def _by_experiment(values: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{name} {' or '.join(map(shortened, of))}" for name, of in values.items())


def shortened(text: str) -> str:
    """A value for a table or a sentence: of a long one the ends, as paths differ in the last."""
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]}…{text[1 - half :]}"


def _text(value: object) -> str:
    """A value as one reads it: what is built from a class, as its call."""
    if isinstance(value, Mapping) and "_target_" in value:
        arguments = {key: one for key, one in value.items() if not key.startswith("_")}
        listed = ", ".join(f"{key}={_text(one)}" for key, one in arguments.items())
        return f"{value['_target_'].rpartition('.')[2]}({listed})"
    return value if isinstance(value, str) else json.dumps(value)


def _told(text: str, value: object) -> str:
    """A line of `SHARED`. What limits an epoch is a share of the frames, or a number of batches."""
    if text == LIMIT and isinstance(value, int):
        return f"each of {value} batches"
    return text.format(shortened(_text(value)))
