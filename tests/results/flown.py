"""Perceptions that were flown, as files: some voxels right, and as many collisions as one says."""

from functools import cache
from itertools import product

import pandas as pd
import torch

from src.metrics.suite import ScoreSuite
from src.results.counts import Counts
from tests.results.scored import predicted, protocol, scene_of, truth

MAPS = ("town-100", "town-101", "town-102")
SECONDS = 8
OTHERS = ("town-300", "town-301")


def write_flown(root, name, right, collides, stratum="damaged", sets=("flown",), before=None):
    """Two flights a map; ``collides(map number, flight number)`` tells which collide.

    The set ``verge`` is of `OTHERS`. A share ``right`` of the voxels is right, of the seconds
    before a collision ``before``.
    """
    rows = []
    for m, town in enumerate(MAPS):
        for n in range(2):
            flight, hit = f"{town}/{n:03d}", collides(m, n)
            rows.append(
                {"flight": flight, "map": town, "stratum": "conflict", "perception": name}
                | {"outcome": "collided" if hit else "arrived", "fault": "missed" if hit else ""}
                | {"time_s": float(SECONDS), "path_m": 60.0, "truth_s": 12.0, "clearance_m": 1.0}
                | {"plans": 60, "regret_m": 0.1, "unsafe_plans": 0, "phantom_stops": 0}
                | {"jerk2": 1.0}
            )
    for frames, (m, n) in product(sets, product(range(len(MAPS)), range(2))):
        maps = OTHERS if frames == "verge" else MAPS
        if m < len(maps):
            flight = f"{maps[m]}/{n:03d}"
            path = root / stratum / name / frames / "frames" / f"{flight}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            shares = [right] * SECONDS
            if before is not None and collides(m, n):
                shares[-3:-1] = before, before
            counts_of(flight, shares, seed=10 * m + n).write(path)
    folder = root / stratum / name / "flown"
    folder.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(folder / "flights.csv", index=False)


def counts_of(flight, shares, seed):
    """Counts of the seconds of a flight, whose frames are right in these shares."""
    seconds = [tables_of(share, seed) for share in shares]
    tables = {
        metric: {name: torch.cat([each[metric][name] for each in seconds]) for name in counts}
        for metric, counts in seconds[0].items()
    }
    clips = [f"{flight}@{second}" for second in range(len(shares))]
    return Counts("flown", protocol(), clips, [2] * len(clips), tables)


@cache
def tables_of(share, seed):
    """Counts of one second. They do not change, so flights share them."""
    suite, target = ScoreSuite.of(protocol(), ["any"]), truth(2, seed=seed)
    suite.update(predicted(target, share, seed), scene_of(target, "any"))
    return suite.counts()
