"""Scores of flights: how often they end well, and what a perception costs beyond the camera's."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from pandas.api.types import is_numeric_dtype
from torch import Generator, Tensor

from ..errors import UserError
from ..run_folder import UNKNOWN_RECIPE
from .bootstrap import interval_of, resamplings, seed_resamplings

# A score is a sum over flights by another one; each is better lower but for the first two.
SCORES = {
    "success": ("arrived", "flights"),
    "success_by_time": ("in_time", "flights"),
    "speed_mps": ("path_m", "time_s"),
    "collisions": ("collided", "flights"),
    "collisions_per_km": ("collided", "path_km"),
    "stuck": ("stuck", "flights"),
    "late": ("late", "flights"),
    "near": ("near", "flights"),
    "missed": ("missed", "flights"),
    "planned_into": ("planned_into", "flights"),
    "ran_into_us": ("ran_into_us", "flights"),
    "regret_m": ("regrets_m", "plans"),
    "unsafe_plans": ("unsafe_plans", "plans"),
    "phantom_stops_per_min": ("phantom_stops", "minutes"),
    "jerk2": ("jerk2_path", "path_m"),
}
# Differences from the reference, of all flights and of those that both completed.
EXCESS = ("collisions", "stuck", "near", "phantom_stops_per_min")
EXCESS_BOTH = ("speed_mps", "jerk2")
# Nearer than this, from the body's center, is a near miss.
NEAR_M = 0.5
ALL = "all"
# What task=fly leaves in a folder.
FLIGHTS = "flights.csv"


def flight_scores(
    flights: Mapping[str, Mapping[str, pd.DataFrame]],
    reference: str | None,
    resamples: int,
    generator: Generator,
) -> pd.DataFrame:
    """Returns the scores of perceptions that flew the same missions, by stratum and over all.

    ``flights`` are their tables of flights, by the seed of their training. A score is the mean over
    the seeds. Intervals are over resampled maps and seeds, the same ones for all
    perceptions. ``excess_*`` are differences from the ``reference``, paired by flight and, where it
    has several, by seed: what is lost beyond what the camera's view and the planner lose;
    ``speed_mps`` and ``jerk2`` only over flights on which both arrived. ``p`` of a difference is
    twice the share of resamples in which it is none or has the other sign, and ``p_holm`` the same
    for all perceptions together, by Holm's rule.
    ``success_by_time`` weighs success by the time that a UAV needs that knows the truth, as a share
    of the time taken.

    Raises `UserError` for perceptions that flew other missions, and for other seeds than the
    reference's, where both have several.
    """
    tables = [(name, table) for name, of_seeds in flights.items() for table in of_seeds.values()]
    require_same_flights(tables)
    rows = []
    for stratum in (*sorted(set(tables[0][1]["stratum"])), ALL):
        kept: dict[str, dict[str, pd.DataFrame]] = {}
        for name, of_seeds in flights.items():
            for seed, each in sorted(of_seeds.items()):
                is_of = (each["stratum"] == stratum) | (stratum == ALL)
                kept.setdefault(name, {})[seed] = each[is_of]
        rows += _of_stratum(kept, stratum, reference, resamples, generator)

    table = pd.DataFrame(rows)
    if "p" in table:
        by_family = table.groupby(["stratum", "score"])["p"]
        table["p_holm"] = by_family.transform(holm)
    return table


def holm(p_values: pd.Series) -> pd.Series:
    """Returns p-values of one family as its step-down rule corrects them (Holm, 1979); NaN stay."""
    ordered = p_values.dropna().sort_values(kind="stable")
    steps = ordered * range(len(ordered), 0, -1)
    return steps.cummax().clip(upper=1.0).reindex(p_values.index)


def _of_stratum(
    flights: Mapping[str, Mapping[str, pd.DataFrame]],
    stratum: str,
    reference: str | None,
    resamples: int,
    generator: Generator,
) -> list[dict[str, object]]:
    # The first row is of all maps, once each; so it is with the seeds.
    some = next(iter(next(iter(flights.values())).values()))
    maps = len(set(some["map"]))
    weights = torch.cat([torch.ones(1, maps), resamplings(maps, resamples, generator)])
    shares = {
        n: torch.cat([torch.ones(1, n), seed_resamplings(n, resamples, generator)]) / n
        for n in sorted(set(map(len, flights.values())))
    }

    rows = []
    for name, of_seeds in flights.items():
        key = {"perception": name, "recipe": _recipe_of(of_seeds.values()), "stratum": stratum}
        key |= {"seeds": len(of_seeds), "flights": len(some)}
        samples = [samples_of(each, weights) for each in of_seeds.values()]
        values = {score: [each[score] for each in samples] for score in SCORES}
        if reference in flights and name != reference:
            values |= _excess(_paired(name, reference, flights), weights)

        for score, of_score in values.items():
            sample = (torch.stack(of_score, dim=1) * shares[len(of_score)]).sum(1)
            rows.append({**key, "score": score, **interval_of(sample)._asdict()})
            if score not in SCORES:
                rows[-1]["p"] = p_value(sample)
    return rows


def _recipe_of(tables: Iterable[pd.DataFrame]) -> str:
    """Returns the recipe of the flights; an unknown one where their table is older than recipes."""
    said = (each["recipe"].iloc[-1] if "recipe" in each else "" for each in tables)
    return ", ".join(dict.fromkeys(recipe or UNKNOWN_RECIPE for recipe in said))


def _paired(
    name: str, reference: str, flights: Mapping[str, Mapping[str, pd.DataFrame]]
) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
    """Returns the tables of two perceptions, seed by seed; what has no seeds stands beside each."""
    own, others = flights[name], flights[reference]
    if len(own) == 1 or len(others) == 1:
        return list(product(own.values(), others.values()))
    if list(own) != list(others):
        raise UserError(
            f"{name} has the seeds {', '.join(own)} and {reference} {', '.join(others)}; give the "
            "same seeds"
        )
    return list(zip(own.values(), others.values()))


def _excess(
    pairs: Sequence[tuple[pd.DataFrame, pd.DataFrame]], weights: Float[Tensor, "1+r maps"]
) -> dict[str, list[Float[Tensor, "1+r"]]]:
    """Returns the differences of each pair, whole and resampled."""
    found: dict[str, list[Tensor]] = {}
    for pair in pairs:
        for scores, tables in ((EXCESS, pair), (EXCESS_BOTH, _completed_by_both(*pair))):
            one, other = (samples_of(each, weights) for each in tables)
            for score in scores:
                found.setdefault(f"excess_{score}", []).append(one[score] - other[score])
    return found


def p_value(sample: Float[Tensor, "1+r"]) -> float:
    """Returns the p-value of a difference, whole and resampled: that it is none."""
    drawn = sample[1:][~sample[1:].isnan()]
    fewer = min(int((drawn <= 0).sum()), int((drawn >= 0).sum()))
    # One more, as the whole may be one of them: no p-value is 0.
    return min(2 * (fewer + 1) / (len(drawn) + 1), 1.0)


def samples_of(
    table: pd.DataFrame, weights: Float[Tensor, "1+r maps"]
) -> dict[str, Float[Tensor, "1+r"]]:
    """Returns each score of the flights, whole and resampled."""
    sums = torch.tensor(_events(table).groupby(table["map"]).sum().to_numpy(float))
    drawn = dict(zip(_events(table).columns, (weights @ sums).T))
    return {name: drawn[above] / drawn[below] for name, (above, below) in SCORES.items()}


def _events(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the terms that each flight adds to the sums of `SCORES`."""
    outcomes = {name: table["outcome"] == name for name in ("arrived", "collided", "stuck", "late")}
    faults = {name: table["fault"] == name for name in ("missed", "planned_into", "ran_into_us")}
    in_time = outcomes["arrived"] * (table["truth_s"] / table["time_s"]).clip(upper=1.0)
    numbers = {"path_m": table["path_m"], "path_km": table["path_m"] / 1000}
    numbers |= {"time_s": table["time_s"], "minutes": table["time_s"] / 60, "in_time": in_time}
    numbers |= {name: table[name] for name in ("plans", "unsafe_plans", "phantom_stops")}
    numbers |= {"regrets_m": table["regret_m"] * table["plans"], "flights": 1}
    numbers |= {"jerk2_path": table["jerk2"] * table["path_m"]}
    return pd.DataFrame({**outcomes, **faults, **numbers, "near": table["clearance_m"] < NEAR_M})


def _completed_by_both(*tables: pd.DataFrame) -> list[pd.DataFrame]:
    """Returns the tables with zeros for the flights that one of the perceptions did not complete;
    a map keeps its place."""
    indexed = [table.sort_values("flight", ignore_index=True) for table in tables]
    both = np.logical_and(*(table["outcome"].to_numpy() == "arrived" for table in indexed))
    numbers = [name for name in indexed[0].columns if is_numeric_dtype(indexed[0][name])]
    for table in indexed:
        table.loc[~both, numbers] = 0
    return indexed


def require_same_flights(flights: Sequence[tuple[str, pd.DataFrame]]) -> None:
    """Raises `UserError` for perceptions that flew other missions than the first."""
    # Names alone do not tell: other code may draw other missions under the same ones.
    identity = ["flight", "stratum", "truth_s"]
    missions = [set(table[identity].itertuples(index=False, name=None)) for _, table in flights]
    for (name, _), own in zip(flights, missions):
        if own != missions[0]:
            raise UserError(
                f"{name} did not fly the missions of {flights[0][0]}; fly them with the same "
                "mission, planner, airframe and task.rules, to the end"
            )
