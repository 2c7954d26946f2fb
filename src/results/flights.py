"""Scores of flights: how often they end well, and what a perception costs beyond the camera's."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from lzma import LZMAError
from pathlib import Path
from tarfile import TarError

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from pandas.api.types import is_numeric_dtype
from torch import Generator, Tensor

from ..data.files import BROKEN
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
TERMS = sorted({term for terms in SCORES.values() for term in terms})
OUTCOMES = ("arrived", "collided", "stuck", "late")
FAULTS = ("missed", "planned_into", "ran_into_us")
# Other columns of a flight.
NUMBERS = ("time_s", "path_m", "truth_s", "clearance_m", "jerk2", "regret_m")
NUMBERS += ("plans", "unsafe_plans", "phantom_stops")
# Differences from the reference, of all flights and of those that both completed.
EXCESS = ("collisions", "stuck", "near", "phantom_stops_per_min")
EXCESS_BOTH = ("speed_mps", "jerk2")
# Nearer than this, from the body's center, is a near miss.
NEAR_M = 0.5
ALL = "all"
# Tables of flights: of perceptions, by the seed of their training; and of two, pair by pair.
Flights = Mapping[str, Mapping[str, pd.DataFrame]]
Pairs = list[tuple[pd.DataFrame, pd.DataFrame]]
Sums = Float[Tensor, "n terms"]
# What task=fly leaves in a folder.
FLIGHTS = "flights.csv"


def flight_scores(
    flights: Flights, reference: str | None, resamples: int, generator: Generator
) -> pd.DataFrame:
    """Returns the scores of perceptions that flew the same missions, by stratum and over all.

    ``flights`` are their tables of flights, by the seed of their training. A score is the mean over
    the seeds. Intervals are over resampled maps and seeds, the same ones for all
    perceptions. ``excess_*`` are differences from the ``reference``, paired by flight and, where it
    has several, by seed: what is lost beyond what the camera's view and the planner lose;
    ``speed_mps`` and ``jerk2`` only over flights on which both arrived. ``p`` of a difference is
    the share of random exchanges in which it is as large: the two perceptions change places on
    some maps. ``p_holm`` is the same for all perceptions together, by Holm's rule. A single map
    has no interval.
    ``success_by_time`` weighs success by the time that a UAV needs that knows the truth, as a share
    of the time taken.

    Raises `UserError` for perceptions that flew other missions or one twice, and for other seeds
    than the reference's, where both have several.
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
        table["p_holm"] = table.groupby(["stratum", "score"])["p"].transform(holm)
    return table


def read_flights(path: Path) -> pd.DataFrame:
    """Reads flights of `task=fly`. Raises `UserError` for a file that is no such table."""
    try:
        table = pd.read_csv(path, keep_default_na=False)
        numbers = table[[*NUMBERS]].astype(float)
        sound = np.isfinite(numbers).all(axis=1) & (numbers["time_s"] > 0)
        sound &= table["outcome"].isin(OUTCOMES) & table["fault"].isin([*FAULTS, ""])
        if table.empty or not sound.all():
            raise ValueError(f"row {int(sound.argmin()) + 1}" if len(table) else "no row")
    except (*BROKEN, LZMAError, TarError) as error:
        raise UserError(
            f"{path} is no table of flights ({' '.join(str(error).split())}); give a folder of "
            f"task=fly, or unpack an archive: python -m tarfile -e {path} FOLDER"
        ) from error
    return table


def holm(p_values: pd.Series) -> pd.Series:
    """Returns p-values of one family as its step-down rule corrects them (Holm, 1979); NaN stay."""
    ordered = p_values.dropna().sort_values(kind="stable")
    steps = ordered * range(len(ordered), 0, -1)
    return steps.cummax().clip(upper=1.0).reindex(p_values.index)


def _of_stratum(
    flights: Flights,
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
    # Exchanges have a generator of their own, so that they move no interval.
    chance = Generator().manual_seed(generator.initial_seed())
    exchanges = torch.randint(2, (resamples, maps), generator=chance).double()

    rows = []
    for name, of_seeds in flights.items():
        key = {"perception": name, "recipe": _recipe_of(of_seeds.values()), "stratum": stratum}
        key |= {"seeds": len(of_seeds), "flights": len(some)}
        samples = [samples_of(each, weights) for each in of_seeds.values()]
        values = {score: [each[score] for each in samples] for score in SCORES}
        exchanged: dict[str, list[Tensor]] = {}
        if reference in flights and name != reference:
            pairs = _paired(name, reference, flights)
            values |= _excess(pairs, lambda one, other: (weights @ one, weights @ other))
            exchanged = _excess(pairs, lambda one, other: _exchanged(one, other, exchanges))

        for score, of_score in values.items():
            sample = (torch.stack(of_score, dim=1) * shares[len(of_score)]).sum(1)
            bounds = interval_of(sample if maps > 1 else sample[:1])._asdict()
            rows.append({**key, "score": score, **bounds})
            if score in exchanged:
                rows[-1]["p"] = _p_value(sample[0], torch.stack(exchanged[score]).mean(0))
    return rows


def _recipe_of(tables: Iterable[pd.DataFrame]) -> str:
    """Returns the recipe of the flights; an unknown one where their table is older than recipes."""
    said = (each["recipe"].iloc[-1] if "recipe" in each else "" for each in tables)
    return ", ".join(dict.fromkeys(recipe or UNKNOWN_RECIPE for recipe in said))


def _paired(name: str, reference: str, flights: Flights) -> Pairs:
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
    pairs: Pairs, drawn: Callable[[Sums, Sums], tuple[Sums, Sums]]
) -> dict[str, list[Float[Tensor, "n"]]]:
    """Returns the differences of each pair, of whatever is drawn of the sums by map of both."""
    found: dict[str, list[Tensor]] = {}
    for pair in pairs:
        for scores, tables in ((EXCESS, pair), (EXCESS_BOTH, _completed_by_both(*pair))):
            one, other = map(_scores, drawn(*map(_sums, tables)))
            for score in scores:
                found.setdefault(f"excess_{score}", []).append(one[score] - other[score])
    return found


def _exchanged(one: Sums, other: Sums, exchanges: Float[Tensor, "r maps"]) -> tuple[Sums, Sums]:
    """Returns the sums of two perceptions that change places on the maps marked by a one."""
    turned = exchanges @ (other - one)
    return one.sum(0) + turned, other.sum(0) - turned


def _p_value(difference: Float[Tensor, ""], exchanged: Float[Tensor, "r"]) -> float:
    """Returns how often chance alone makes a difference that large; NaN for none."""
    if difference.isnan():
        return math.nan
    drawn = exchanged[~exchanged.isnan()].abs()
    # One more, as what was found may be one of them: no p-value is 0. Sums are rounded.
    as_large = int((drawn >= difference.abs() * (1 - 1e-9)).sum())
    return (as_large + 1) / (len(drawn) + 1)


def samples_of(
    table: pd.DataFrame, weights: Float[Tensor, "1+r maps"]
) -> dict[str, Float[Tensor, "1+r"]]:
    """Returns each score of the flights, whole and resampled."""
    return _scores(weights @ _sums(table))


def _sums(table: pd.DataFrame) -> Sums:
    """Returns the sums of the terms of `_events` by map."""
    return torch.tensor(_events(table).groupby(table["map"]).sum().to_numpy(float))


def _scores(sums: Sums) -> dict[str, Float[Tensor, "n"]]:
    terms = dict(zip(TERMS, sums.T))
    return {name: terms[above] / terms[below] for name, (above, below) in SCORES.items()}


def _events(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the `TERMS` that each flight adds to the sums of `SCORES`."""
    terms = {name: table["outcome"] == name for name in OUTCOMES}
    terms |= {name: table["fault"] == name for name in FAULTS}
    terms |= {name: table[name] for name in ("path_m", "time_s", "plans")}
    terms |= {name: table[name] for name in ("unsafe_plans", "phantom_stops")}
    terms |= {"path_km": table["path_m"] / 1000, "minutes": table["time_s"] / 60, "flights": 1}
    terms["in_time"] = terms["arrived"] * (table["truth_s"] / table["time_s"]).clip(upper=1.0)
    terms["regrets_m"] = table["regret_m"] * table["plans"]
    terms["jerk2_path"] = table["jerk2"] * table["path_m"]
    terms["near"] = table["clearance_m"] < NEAR_M
    return pd.DataFrame(terms, columns=TERMS)


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
    for (name, table), own in zip(flights, missions):
        if (twice := table["flight"].duplicated()).any():
            flight = table["flight"][twice].iloc[0]
            raise UserError(f"{name} has flight {flight} twice; leave one row of it")
        if own != missions[0]:
            raise UserError(
                f"{name} did not fly the missions of {flights[0][0]}; fly them with the same "
                "mission, planner, airframe and task.rules, to the end"
            )
