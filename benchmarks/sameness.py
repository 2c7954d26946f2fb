"""How far finished runs are apart that should be the same: python -m benchmarks.sameness RUN RUN...

Each RUN is the folder of a run of one configuration, trained elsewhere or otherwise; the first is
what the others are compared with. Prints the largest difference of the logged losses, of the mean
scores on the test split and on its parts, and of the anchors' scores, and how many clips of the
data sets differ in any byte.
"""

import argparse
from pathlib import Path

import pandas as pd
import yaml
from rich.console import Console
from rich.table import Table

from src.data.manifest import read_manifest
from src.results.files import MEANS, read_results
from src.run_folder import ANCHORS, CONFIG, METRICS, RESULTS


def differences(first: Path, other: Path) -> tuple[float, float, float, float]:
    """The largest of the losses, of the network's scores on the test split and on its parts, and of
    the anchors' scores."""
    logs = [pd.read_csv(run / METRICS).set_index("step") for run in (first, other)]
    names = [name for name in logs[0] if "/" in name and ("train" in name or "loss" in name)]
    losses = (logs[0][names] - logs[1][names]).abs().max(axis=None)

    tables = [
        read_results(run / RESULTS).set_index(["experiment", "split"])[list(MEANS)]
        for run in (first, other)
    ]
    scores = (tables[0] - tables[1]).abs().max(axis=1)
    experiment, split = (scores.index.get_level_values(level) for level in scores.index.names)
    of_anchor, of_whole = experiment.isin(ANCHORS), split == "test"
    chosen = (~of_anchor & of_whole, ~of_anchor & ~of_whole, of_anchor)
    return losses, *(scores[rows].max() for rows in chosen)


def clips_of(run: Path) -> dict[str, str]:
    """The digest of every clip of the data set that a run was trained on."""
    dataset = read_results(run / RESULTS)["dataset"].iloc[0]
    paths = yaml.safe_load((run / CONFIG).read_text())["paths"]
    manifest = read_manifest(Path(paths["dataset"] or Path(paths["data"]) / dataset))
    return {clip: listed["sha256"] for clip, listed in manifest["clips"].items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    first, *others = parser.parse_args().runs
    table = Table(title=f"largest differences from {first}")
    for column in ("run", "losses", "test", "its parts", "anchors", "clips that differ"):
        table.add_column(column, justify="left" if column == "run" else "right", overflow="fold")
    clips = clips_of(first)
    for other in others:
        apart = clips_of(other)
        differing = sum(apart.get(clip) != digest for clip, digest in clips.items())
        numbers = (f"{number:.1e}" for number in differences(first, other))
        table.add_row(str(other), *numbers, f"{differing} of {len(clips)}")
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
