"""Scores of flights: shares, differences paired by flight, intervals over maps."""

import pandas as pd
import pytest
import torch

from src.errors import UserError
from src.results.flights import flight_scores


def table(outcomes, perception="any", time_s=12.0, maps=4):
    """Flights of some maps with the same outcomes on each."""
    rows = [
        dict(
            flight=f"m{m}/{n}", map=f"m{m}", stratum="clear" if n == 0 else "conflict",
            perception=perception, outcome=outcome, time_s=time_s, path_m=60.0, truth_s=12.0,
            clearance_m=0.2 if outcome == "collided" else 1.0,
            fault="missed" if outcome == "collided" else "",
        )
        for m in range(maps)
        for n, outcome in enumerate(outcomes)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def scores(flights, reference="seen", **changes):
    generator = torch.Generator().manual_seed(0)
    long = flight_scores(flights, reference, changes.get("resamples", 200), generator)
    return long.set_index(["perception", "stratum", "score"])


def test_scores_are_sums_over_flights():
    values = scores({"seen": table(["arrived", "arrived", "collided", "stuck"], time_s=15.0)})
    all_of = values.loc["seen", "all"]["value"]
    assert all_of[["success", "collisions", "stuck", "near", "missed"]].tolist() == [
        *(0.5, 0.25, 0.25, 0.25, 0.25)
    ]
    assert all_of["speed_mps"] == 4.0
    assert all_of["collisions_per_km"] == pytest.approx(1 / 0.24)
    assert all_of["success_by_time"] == pytest.approx(0.5 * 12 / 15)
    assert values.loc[("seen", "conflict", "success"), "value"] == pytest.approx(1 / 3)
    assert values.loc[("seen", "clear", "success"), "value"] == 1.0


def test_what_is_lost_beyond_the_reference_is_paired_by_flight():
    """Where every map has the same, both the score and the difference are certain."""
    flights = {
        "seen": table(["arrived", "collided", "arrived", "arrived"], "seen"),
        "model": table(["arrived", "collided", "collided", "arrived"], "model"),
    }
    values = scores(flights)
    assert values.loc[("model", "all", "excess_collisions")].tolist()[1:] == [0.25, 0.25, 0.25]
    assert ("seen", "all", "excess_collisions") not in values.index
    assert ("model", "all", "excess_collisions") not in scores(flights, reference=None).index


def test_intervals_come_from_the_maps():
    worse = table(["arrived", "arrived"])
    worse.loc[worse["map"] == "m0", "outcome"] = "collided"
    row = scores({"seen": worse}).loc[("seen", "all", "collisions")]
    assert (row["value"], row["low"]) == (0.25, 0.0)
    assert 0.5 <= row["high"] <= 1.0


def test_the_order_of_the_rows_does_not_matter():
    worse = table(["arrived", "stuck", "collided"])
    worse.loc[worse["map"] == "m1", "outcome"] = "late"
    assert scores({"seen": worse}).equals(scores({"seen": worse.sample(frac=1, random_state=0)}))


def test_perceptions_that_flew_other_missions_are_refused():
    flights = {"seen": table(["arrived"]), "model": table(["arrived"], maps=3)}
    with pytest.raises(UserError, match="model did not fly the missions of seen"):
        scores(flights)
