"""Scores of flights: shares, differences paired by flight, intervals over maps."""

import pandas as pd
import pytest
import torch

from src.errors import UserError
from src.results.flights import flight_scores, holm


def table(outcomes, perception="any", time_s=12.0, maps=4):
    """Flights of some maps with the same outcomes on each."""
    rows = [
        dict(
            flight=f"m{m}/{n}", map=f"m{m}", stratum="clear" if n == 0 else "conflict",
            perception=perception, outcome=outcome, time_s=time_s, path_m=60.0, truth_s=12.0,
            clearance_m=0.2 if outcome == "collided" else 1.0,
            fault="missed" if outcome == "collided" else "", jerk2=2.0, plans=10,
            regret_m=0.5, unsafe_plans=2, phantom_stops=1 if outcome == "stuck" else 0,
        )
        for m in range(maps)
        for n, outcome in enumerate(outcomes)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def scores(flights, reference="seen", **changes):
    generator = torch.Generator().manual_seed(0)
    flights = {name: own if isinstance(own, dict) else {"": own} for name, own in flights.items()}
    long = flight_scores(flights, reference, changes.get("resamples", 200), generator)
    return long.set_index(["perception", "stratum", "score"]).sort_index()


def test_scores_are_sums_over_flights():
    values = scores({"seen": table(["arrived", "arrived", "collided", "stuck"], time_s=15.0)})
    all_of = values.xs(("seen", "all"))["value"]
    assert all_of[["success", "collisions", "stuck", "near", "missed"]].tolist() == [
        *(0.5, 0.25, 0.25, 0.25, 0.25)
    ]
    assert all_of["speed_mps"] == 4.0
    assert all_of["collisions_per_km"] == pytest.approx(1 / 0.24)
    assert all_of["success_by_time"] == pytest.approx(0.5 * 12 / 15)
    assert values.loc[("seen", "conflict", "success"), "value"] == pytest.approx(1 / 3)
    assert values.loc[("seen", "clear", "success"), "value"] == 1.0


def test_what_a_twin_would_have_done_is_counted_by_plan_and_by_minute():
    one = table(["arrived", "stuck"])
    one.loc[one["outcome"] == "stuck", ["plans", "regret_m", "time_s"]] = [30, 1.5, 18.0]
    value = scores({"seen": one}).xs(("seen", "all"))["value"]
    assert value["regret_m"] == pytest.approx((10 * 0.5 + 30 * 1.5) / 40)
    assert value["unsafe_plans"] == pytest.approx(4 / 40)
    assert value["phantom_stops_per_min"] == pytest.approx(1 / (30 / 60))
    assert value["jerk2"] == 2.0


def test_speed_and_jerk_are_compared_where_both_arrived():
    """The flight that one of them did not complete was the slow one."""
    flights = {"seen": table(["arrived", "arrived"]), "model": table(["arrived", "collided"])}
    for each, time_s, jerk2 in ((flights["seen"], 10.0, 1.0), (flights["model"], 12.0, 3.0)):
        each["time_s"], each["jerk2"] = time_s, jerk2
    flights["seen"].loc[1::2, "time_s"] = 30.0
    values = scores(flights).loc["model", "all"]
    assert values.loc["excess_speed_mps", "value"] == pytest.approx(60 / 12 - 60 / 10)
    assert values.loc["excess_jerk2", "value"] == pytest.approx(2.0)


def test_p_values_of_several_perceptions_are_corrected_together():
    given = pd.Series([0.04, 0.01, float("nan"), 0.03], index=[3, 1, 7, 0])
    corrected = holm(given)
    assert corrected.tolist() == pytest.approx([0.06, 0.03, float("nan"), 0.06], nan_ok=True)
    worse = table(["arrived", "collided"])
    flights = {"seen": table(["arrived", "arrived"]), "one": worse, "other": worse}
    p = scores(flights, resamples=8000).xs("excess_collisions", level="score")
    # On four maps with one sign, two of the sixteen exchanges are as large; twice.
    assert p.xs("conflict", level="stratum")["p_holm"].tolist() == pytest.approx(
        [2 * 2 / 16] * 2, rel=0.1
    )
    assert p.xs("clear", level="stratum")["p_holm"].tolist() == [1.0, 1.0]
    same = {"seen": worse, "one": worse}
    row = scores(same).loc[("one", "all", "excess_collisions")]
    assert (row["value"], row["p"]) == (0.0, 1.0)


def test_one_map_has_no_interval_and_no_evidence():
    worse, one_map = table(["arrived", "collided"], maps=1), table(["arrived", "arrived"], maps=1)
    row = scores({"seen": one_map, "model": worse}).loc[("model", "all", "excess_collisions")]
    assert row[["value", "p"]].tolist() == [0.5, 1.0]
    assert row[["low", "high"]].isna().all()


def test_a_flight_that_is_there_twice_is_refused():
    twice = pd.concat([table(["collided"]), table(["collided"]).head(1)])
    with pytest.raises(UserError, match="m0/0 twice"):
        scores({"seen": twice})


def test_what_is_lost_beyond_the_reference_is_paired_by_flight():
    """Where every map has the same, both the score and the difference are certain."""
    flights = {
        "seen": table(["arrived", "collided", "arrived", "arrived"], "seen"),
        "model": table(["arrived", "collided", "collided", "arrived"], "model"),
    }
    values = scores(flights)
    assert (
        values.loc[("model", "all", "excess_collisions")][["value", "low", "high"]].tolist()
        == [0.25] * 3
    )
    assert ("seen", "all", "excess_collisions") not in values.index
    assert ("model", "all", "excess_collisions") not in scores(flights, reference=None).index


def test_a_score_is_the_mean_over_the_seeds_and_a_difference_is_paired_by_seed():
    """On every map the same, so only the drawn seeds move a mean, and nothing a difference."""
    good, bad, worse = (table(["collided"] * n + ["arrived"] * (4 - n)) for n in (0, 1, 2))
    flights = {"seen": good, "early": {"0": bad, "1": worse}, "late": {"1": bad, "0": good}}
    values = scores(flights).xs("all", level="stratum")
    of_early = values.loc["early", "collisions"]
    assert of_early[["value", "low", "high"]].tolist() == [0.375, 0.25, 0.5]
    assert (of_early["seeds"], of_early["flights"]) == (2, 16)
    assert values.loc[("early", "excess_collisions"), "value"] == 0.375

    apart = scores(flights, "late").xs("all", level="stratum").loc[:, ["value", "low", "high"]]
    assert apart.loc[("early", "excess_collisions")].tolist() == [0.25] * 3
    assert apart.loc[("seen", "excess_collisions")].tolist() == [-0.125, -0.25, 0.0]

    with pytest.raises(UserError, match="early has the seeds 0, 1 and late 0, 2; give the same"):
        scores(flights | {"late": {"0": good, "2": bad}}, "late")


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
