"""The differences of runs that should be the same: python -m studies.speed.sameness RUN RUN...

Each RUN is the folder of a run of one configuration, trained elsewhere or otherwise; the others are
compared with the first. Prints the largest difference of the logged losses, of the mean
scores on the test split and on its parts, and of the anchors' scores, and how many clips of the
datasets differ in any byte.
"""

from pathlib import Path

import pandas as pd
import yaml

from src.data.manifest import read_manifest
from src.results.files import MEANS, read_results
from src.run_folder import ANCHORS, CONFIG, METRICS, RESULTS
from studies.settings import run
from studies.tables import print_table


def differences(first: Path, other: Path) -> tuple[float, float, float, float]:
    """Returns the largest differences of the losses and of the scores.

    Scores are the network's on the test split and on its parts, and the anchors'.
    """
    logs = [pd.read_csv(run / METRICS).set_index("step") for run in (first, other)]
    names = [name for name in logs[0] if "/" in name and ("train" in name or "loss" in name)]
    losses = (logs[0][names] - logs[1][names]).abs().max(axis=None)

    tables = [
        read_results(run / RESULTS).set_index(["experiment", "split"])[list(MEANS)]
        for run in (first, other)
    ]
    scores = (tables[0] - tables[1]).abs().max(axis=1)
    experiment, split = (scores.index.get_level_values(level) for level in scores.index.names)
    # Anchors are not trained, so their scores differ only where the data or the scoring do.
    of_anchor, of_whole = experiment.isin(ANCHORS), split == "test"
    chosen = (~of_anchor & of_whole, ~of_anchor & ~of_whole, of_anchor)
    return losses, *(scores[rows].max() for rows in chosen)


def clips_of(run: Path) -> dict[str, str]:
    """Returns the digest of every clip of the dataset that a run was trained on."""
    dataset = read_results(run / RESULTS)["dataset"].iloc[0]
    paths = yaml.safe_load((run / CONFIG).read_text())["paths"]
    manifest = read_manifest(Path(paths["dataset"] or Path(paths["data"]) / dataset))
    return {clip: listed["sha256"] for clip, listed in manifest["clips"].items()}


def main(first: Path, *others: Path) -> None:
    clips, rows = clips_of(first), []
    for other in others:
        other_clips = clips_of(other)
        differing = sum(other_clips.get(clip) != digest for clip, digest in clips.items())
        numbers = (f"{number:.1e}" for number in differences(first, other))
        rows.append((str(other), *numbers, f"{differing} of {len(clips)}"))
    columns = ("run", "losses", "test", "its parts", "anchors", "clips that differ")
    print_table(f"largest differences from {first}", columns, rows)


if __name__ == "__main__":
    run(main)
