"""What task=free_bias has counted: the test split with the free bias that validation prefers."""

from collections.abc import Mapping, Sequence

import pandas as pd

from src.results.counts import Counts, require_comparable
from src.results.runs import ScoredRun
from src.run_folder import TALLIES

# Its folder in a run's folder, and the name of its table.
FREE_BIAS = "free_bias"
BIAS, SCORED = "bias", "val/kar_miou"


def read_free_bias(runs: Sequence[ScoredRun]) -> dict[str, dict[int, Counts]]:
    """Reads the counts of experiments by seed; nothing unless all runs were scored so.

    Raises `UserError` where a run was scored so by another protocol, or on other frames, than
    itself.
    """
    files = [run.path / FREE_BIAS / TALLIES / f"{run.experiment}.npz" for run in runs]
    if not all(file.is_file() for file in files):
        return {}
    counts: dict[str, dict[int, Counts]] = {}
    for run, file in zip(runs, files):
        read = Counts.read(file)
        both = {str(run.path): run.counts, str(file): read}
        require_comparable(both, "run task=free_bias on it again")
        counts.setdefault(run.experiment, {})[run.seed] = read
    return counts


def best_bias(curve: Mapping[float, float]) -> float:
    """Returns the bias with the highest score; of several best ones the smallest."""
    return max(curve, key=lambda each: (curve[each], -abs(each)))


def read_bias(run: ScoredRun) -> float:
    """Reads which bias a run was scored with."""
    table = pd.read_csv(run.path / FREE_BIAS / f"{FREE_BIAS}.csv")
    return best_bias(dict(zip(table[BIAS], table[SCORED])))
