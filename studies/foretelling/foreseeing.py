"""Which score foresees a collision: the seconds before it beside those in which nothing was hit."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float32
from torch import Generator

from src.results.bootstrap import interval_of, resamplings
from studies.foretelling.correlation import FlownPerception
from studies.foretelling.windows import WINDOW_S, Windows

# The window before a collision ends one second or more before it; the earlier one of the same
# flight ends three before that.
BEFORE_S, EARLIER_S = 1, 3
CONTROLS = ("others", "earlier")


def foreseen(
    perceptions: Sequence[FlownPerception],
    windows: Mapping[str, Mapping[str, Windows]],
    reference: pd.DataFrame,
    scores: Mapping[str, str],
    resamples: int,
    generator: Generator,
) -> pd.DataFrame:
    """Returns how well each score tells the seconds before a collision from others.

    ``windows`` has the scores of two seconds at a time, by perception and flight (`windows_of`).
    A row has a score, a control, the number of ``collisions`` on missions that the ``reference``
    completed, how many of them have that control, and the area under the curve (AUROC): the share
    of pairs in which the score was worse in two seconds that end 1 to 2 s before a collision than
    in the control, ties counting half. 0.5 is chance. The control ``others`` is the same seconds of
    the same mission, flown by perceptions that arrived; ``earlier`` is the same flight, 3 s before.
    Where a score has nothing to count it is at its best: nothing was missed.

    Each collision weighs the same. Maps and families of perceptions are resampled together.
    """
    completed = set(reference[reference["outcome"] == "arrived"]["flight"])
    found = pd.DataFrame(_collisions(perceptions, windows, scores, completed))
    if found.empty:
        return pd.DataFrame(columns=["score", "control", "collisions", "compared", "auroc"])
    weights = torch.ones(resamples + 1, len(found), dtype=torch.float64)
    for key in ("map", "family"):
        codes, names = pd.factorize(found[key])
        weights[1:] *= resamplings(len(names), resamples, generator)[:, codes]

    rows = []
    for score in scores:
        for control in CONTROLS:
            won = torch.tensor(found[control, score].to_numpy())
            there = ~won.isnan()
            areas = (weights[:, there] @ won[there]) / weights[:, there].sum(1)
            numbers = {"collisions": len(found), "compared": int(there.sum())}
            area = dict(zip(("auroc", "low", "high"), interval_of(areas)))
            rows.append({"score": score, "control": control, **numbers, **area})
    return pd.DataFrame(rows)


def _collisions(
    perceptions: Sequence[FlownPerception],
    windows: Mapping[str, Mapping[str, Windows]],
    scores: Mapping[str, str],
    completed: set[str],
) -> Iterator[dict[object, object]]:
    """Yields for every collision, by control and score, how often it was worse before it."""
    by_flight = defaultdict(list)
    for each in perceptions:
        for row in each.flights.to_dict("records"):
            if row["flight"] in completed:
                by_flight[row["flight"]].append((each, row))

    for flight, flown in by_flight.items():
        if all(row["outcome"] != "collided" for _, row in flown):
            continue
        values = {each.name: _goodness(windows[each.name][flight], scores) for each, _ in flown}
        arrived = [values[each.name] for each, row in flown if row["outcome"] == "arrived"]

        for each, row in flown:
            if row["outcome"] != "collided":
                continue
            last = math.floor(row["time_s"]) - BEFORE_S - 1
            own = values[each.name]
            controls = {
                "others": [(other, last) for other in arrived],
                "earlier": [(own, last - EARLIER_S)],
            }
            shares = {
                (control, score): _worse(own[score], last, [(w[score], k) for w, k in pairs])
                for control, pairs in controls.items()
                for score in scores
            }
            yield {"map": row["map"], "family": each.family, **shares}


def _goodness(windows: Windows, scores: Mapping[str, str]) -> Windows:
    """Returns the scores with their better end up; with nothing to count they are at their best."""
    return {
        score: np.nan_to_num(windows[score] * (1 if end == "high" else -1), nan=math.inf)
        for score, end in scores.items()
    }


def _worse(
    own: Float32[np.ndarray, "s"],
    last: int,
    controls: Sequence[tuple[Float32[np.ndarray, "s"], int]],
) -> float:
    """Returns the share of controls that were better than a window; NaN without any."""
    first = WINDOW_S - 1
    if not first <= last < len(own):
        return math.nan
    others = np.array([other[k] for other, k in controls if first <= k < len(other)])
    worse = (own[last] < others) + 0.5 * (own[last] == others)
    return float(worse.mean()) if len(others) else math.nan
