"""The cube: what each of the three ideas adds, over all models with and without it.

A ladder gives each idea one order to be tested in. Eight models, one for every choice of the three
factors, give its *main effect*: the mean of what it adds to the four models without it. An
*interaction* of two factors is how much more the one adds where the other is there, too.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

from src.errors import UserError
from src.report.shared_settings import FACTOR_KEYS, SEED, differing, factors_of
from src.results.bootstrap import interval_of
from src.results.render import Cell, Row, Table
from src.results.runs import ScoredRun
from src.results.table import Resamples
from studies.attitude.conditions import Condition
from studies.attitude.tables import AttitudeScores, tilt_in_words
from studies.free_bias.counts import read_bias, read_free_bias

FACTORS = ("attitude-aware projection", "safety class weights", "Lovász loss")
# The scores whose effects are shown, and their names.
SCORES = {
    **{"kar_miou": "KAR-mIoU", "miou": "mIoU", "geometric_iou": "Geometric IoU"},
    **{"primitive_miss": "Primitive miss", "iou/thin_structure": "Thin", "iou/car": "Car"},
    "iou/vru": "VRU",
}
# Each model of the cube has the learning rate that validation prefers.
TUNED = "optimizer.lr"

# Whether a model has each of the `FACTORS`.
Vertex = tuple[bool, bool, bool]


def vertices_of(runs: Sequence[ScoredRun], names: Sequence[str]) -> dict[Vertex, str]:
    """Returns the experiments of the cube that have a run, by the factors that they have.

    Raises `UserError` where none of them has a run, two have the same factors, seeds of one have
    other factors, they differ in a setting beside the factors, the seed and the learning rate, or
    no two differ in one factor alone.
    """
    mine = [run for run in runs if run.experiment in names]
    if names and not mine:
        raise UserError(f"task.cube: no finished run is of {', '.join(names)}")
    for key, by_experiment in differing(mine).items():
        if key not in (*FACTOR_KEYS, SEED, TUNED):
            values = "; ".join(f"{name} {' or '.join(of)}" for name, of in by_experiment.items())
            raise UserError(f"task.cube: its models differ in {key}: {values}; leave others out")

    vertices: dict[Vertex, str] = {}
    for run in mine:
        vertex = factors_of(run.config)
        if (other := vertices.setdefault(vertex, run.experiment)) != run.experiment:
            raise UserError(
                f"task.cube: {other} and {run.experiment} have the same factors; name one of them"
            )
    if len({*vertices.values()}) < len(vertices):
        raise UserError("task.cube: seeds of one experiment have other factors; name them apart")
    if names and next(effects(vertices), None) is None:
        raise UserError(
            f"task.cube: of {', '.join(vertices.values())} no two differ in one factor alone; name "
            "models with and without it that have runs"
        )
    return vertices


def effects(vertices: Mapping[Vertex, str]) -> Iterator[tuple[str, dict[str, float], int]]:
    """Yields the name, the weights of the models, and the number of comparisons, of every main
    effect and every interaction for which there are models."""
    for order in (1, 2, 3):
        for chosen in combinations(range(len(FACTORS)), order):
            # A comparison is of the models that differ in the chosen factors alone.
            comparisons = defaultdict(dict)
            for vertex, name in sorted(vertices.items()):
                held = tuple(has for axis, has in enumerate(vertex) if axis not in chosen)
                lacking = sum(not vertex[axis] for axis in chosen)
                comparisons[held][name] = (-1) ** lacking

            whole = [each for each in comparisons.values() if len(each) == 2**order]
            if whole:
                weights = {name: sign / len(whole) for each in whole for name, sign in each.items()}
                yield " x ".join(FACTORS[axis] for axis in chosen), weights, len(whole)


def cube_tables(
    runs: Sequence[ScoredRun],
    vertices: Mapping[Vertex, str],
    parts: Mapping[str, Resamples],
    attitude: AttitudeScores,
) -> list[Table]:
    """Returns the effects on every part of the test split; at the weight of free that validation
    prefers, where all models were scored with that; and that of the attitude by tilt, where all
    were scored so. Without ``vertices`` there is none."""
    if not vertices:
        return []

    tables = []
    for part, resamples in parts.items():
        suffix = "" if part == "test" else f"_{part}"
        title = f"Effects, {part} of {resamples.first.protocol.dataset}"
        tables.append(_effects_table(f"cube{suffix}", title, resamples, vertices))

    of_cube = [run for run in runs if run.experiment in vertices.values()]
    if tuned := read_free_bias(of_cube):
        of_tuned = Resamples(tuned)
        tables.append(_tuned_table(of_cube, of_tuned))
        title = "Effects at the weight of free that validation prefers, test"
        tables.append(_effects_table("cube_free_bias", title, of_tuned, vertices))

    bins = {
        condition: resamples
        for condition, resamples in attitude.resamples.items()
        if condition.is_bin
        and not condition.level
        and resamples.samples.keys() >= {*vertices.values()}
    }
    found = {name: weights for name, weights, _ in effects(vertices)}
    if bins and FACTORS[0] in found:
        tables.append(_by_tilt(bins, found[FACTORS[0]]))
    return tables


def _effects_table(
    key: str, title: str, resamples: Resamples, vertices: Mapping[Vertex, str]
) -> Table:
    """Returns the effects on every score, in percentage points, with paired intervals."""
    scores = _shown(resamples)
    rows: list[Row] = []
    for name, weights, comparisons in effects(vertices):
        cells = [_cell(resamples, weights, score) for score in scores]
        rows.append((name, [str(comparisons), *cells]))

    text = (
        "What a factor adds, in percentage points: the mean over models that differ in it alone. "
        "Of an interaction (x): how much more the one adds where the other is there, too."
    )
    return Table(key, title, text, ["models", *scores.values()], rows, head="Effect of")


def _tuned_table(runs: Sequence[ScoredRun], resamples: Resamples) -> Table:
    """Returns the models at the weight of free that validation prefers, and that of each seed."""
    scores = _shown(resamples)
    rows: list[Row] = []
    for name in resamples.samples:
        biases = [f"{read_bias(run):+g}" for run in runs if run.experiment == name]
        cells = [_cell(resamples, {name: 1.0}, score, signed=False) for score in scores]
        rows.append((name, [", ".join(biases), *cells]))

    text = (
        "What is added to the logit of free, in nats, is the number with the highest KAR-mIoU on "
        "validation, of each seed. Primitive miss has a threshold of its own."
    )
    columns, best = ["added to free", *scores.values()], dict.fromkeys(scores.values(), "high")
    best |= {SCORES["primitive_miss"]: "low"}
    title = "Models at the weight of free that validation prefers, test"
    return Table("free_bias", title, text, columns, rows, best=best)


def _by_tilt(bins: Mapping[Condition, Resamples], weights: Mapping[str, float]) -> Table:
    """Returns the gain of KAR-mIoU by the attitude in frames of each tilt."""
    cells = [_cell(resamples, weights, "kar_miou") for resamples in bins.values()]
    columns = [tilt_in_words(condition, each.frames) for condition, each in bins.items()]
    text = "Effect on KAR-mIoU in frames of each tilt |roll| + |pitch|."
    rows: list[Row] = [(FACTORS[0], cells)]
    return Table("cube_tilt", "Effect by tilt", text, columns, rows, head="Effect of")


def _shown(resamples: Resamples) -> dict[str, str]:
    """Returns those of the `SCORES` that there are, and their names."""
    some = next(iter(next(iter(resamples.samples.values())).values()))
    return {score: name for score, name in SCORES.items() if score in some}


def _cell(
    resamples: Resamples, weights: Mapping[str, float], score: str, signed: bool = True
) -> Cell | None:
    sample = resamples.combined(weights, score)
    if sample is None:
        return None
    return Cell(*(100 * end for end in interval_of(sample, resamples.level)), signed=signed)
