"""What task=free_bias has counted: the test split with the free bias that validation prefers."""

from collections.abc import Sequence

from ..run_folder import TALLIES
from .counts import Counts
from .runs import ScoredRun

# Its folder in a run's folder, and the name of its table.
FREE_BIAS = "free_bias"


def read_free_bias(runs: Sequence[ScoredRun]) -> dict[str, dict[int, Counts]]:
    """Reads the counts of experiments by seed; nothing unless all runs were scored so."""
    files = [run.path / FREE_BIAS / TALLIES / f"{run.experiment}.npz" for run in runs]
    if not all(file.is_file() for file in files):
        return {}
    counts: dict[str, dict[int, Counts]] = {}
    for run, file in zip(runs, files):
        counts.setdefault(run.experiment, {})[run.seed] = Counts.read(file)
    return counts
