"""task=fly: flights in a yard, the same with any workers, resumed; mistakes in one line."""

import re

import pandas as pd
import pytest
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from mcap.reader import make_reader
from omegaconf import OmegaConf
from PIL import Image

from src.errors import UserError
from src.failures import one_line
from src.loop.campaign import Campaign, Job
from src.report.flight_film import SHOWN
from src.results.counts import Counts
from src.results.flights import FLIGHTS
from src.tasks.fly import films_of, fly_together
from tests.synthetic import sound_config

YARD = (
    "task=fly", "scale=tiny", "mission.towns=[tests.loop.yard]", 
    "mission.maps=2", "mission.conflict=1", "mission.clear=1", "mission.offset_m=[3.0,9.0]",
)  # fmt: skip
# A mission through the yard's wall.
ROW = {
    **{"flight": "a", "stratum": "conflict", "town": "tests.loop.yard", "weather": "clear"},
    **{"seed": 0, "index": 0, "x_m": -30.0, "y_m": 0.0, "yaw_rad": 0.0, "truth_s": 12.0},
    **{"length_m": 60.0, "height_m": 4.0},
}
COLUMNS = [
    *("flight", "map", "town", "stratum", "perception", "outcome", "time_s", "path_m"),
    *("clearance_m", "hit", "fault"),
]


def config(tmp_path, *overrides):
    # The missions are drawn once for all tests.
    paths = f"paths.data={tmp_path.parent}/missions", f"paths.runs={tmp_path}/runs"
    return sound_config(*YARD, *paths, *overrides)


def plain(*arguments):
    return OmegaConf.to_container(config(*arguments), resolve=True)


def run(cfg, **changes):
    for key, value in changes.items():
        cfg.task[key] = value
    instantiate(cfg.task)(cfg)
    return pd.read_csv(f"{cfg.task.out}/{FLIGHTS}", keep_default_na=False)


@pytest.mark.slow
def test_flights_are_the_same_with_any_workers_and_resumed(tmp_path, capsys):
    cfg = config(tmp_path, "perception=all_free", "task.films=false")
    two = run(cfg, workers=2, out=f"{tmp_path}/two")
    assert list(two.columns)[: len(COLUMNS)] == COLUMNS
    assert two["stratum"].value_counts().to_dict() == {"conflict": 2, "clear": 2}
    assert set(two[two["stratum"] == "conflict"]["outcome"]) == {"collided"}
    assert set(two[two["stratum"] == "clear"]["outcome"]) == {"arrived"}
    assert set(two["recipe"]) == {"none"}, "nothing was trained"

    one = run(cfg, workers=1, out=f"{tmp_path}/one")
    half = two.head(2)
    half.to_csv(tmp_path / "one" / FLIGHTS, index=False)
    again = run(cfg, workers=1, out=f"{tmp_path}/one")
    assert one.equals(two)
    assert again.equals(two)

    cfg = config(tmp_path, "perception=seen", "task.workers=2")
    capsys.readouterr()
    seen = run(cfg)
    assert set(seen["outcome"]) == {"arrived"}
    printed = capsys.readouterr().out
    for name in films_of(seen):
        assert all(f"{cfg.task.out}/{name}.{ending}" in printed for ending in ("gif", "html"))
        with Image.open(f"{cfg.task.out}/{name}.gif") as film:
            assert film.n_frames == SHOWN
        with open(f"{cfg.task.out}/{name}.mcap", "rb") as file:
            counts = make_reader(file).get_summary().statistics.channel_message_counts
        # Of every plan, in the order of their channels: tf, calibration, image, truth, belief.
        plans = int(seen.set_index("flight").loc[films_of(seen)[name], "plans"])
        assert [*counts.values()][1:] == [plans] * 4
    assert run(config(tmp_path, "perception=seen")).equals(seen)
    with pytest.raises(UserError, match=r"another configuration.*task.out"):
        run(config(tmp_path, "perception=truth"), out=f"{tmp_path}/one")


@pytest.mark.slow
def test_perceptions_that_take_turns_fly_as_each_does_alone(tmp_path):
    perceptions, words = ("seen", "all_free", "truth"), ("task.films=false", "task.workers=1")
    alone = [run(config(tmp_path, *words, f"perception={each}")) for each in perceptions]

    folders = [tmp_path / "together" / each for each in perceptions]
    configs = [
        plain(tmp_path, *words, f"perception={folder.name}", f"task.out={folder}")
        for folder in folders
    ]
    fly_together(configs)
    flown = [pd.read_csv(folder / FLIGHTS, keep_default_na=False) for folder in folders]
    assert all(map(pd.DataFrame.equals, flown, alone))

    other = plain(tmp_path, "mission.maps=1", f"task.out={tmp_path}/other")
    with pytest.raises(UserError, match=r"other: flies other missions than the first one"):
        fly_together([*configs, other])


@pytest.mark.slow
def test_beliefs_are_scored_in_flight_and_by_who_looks_on(tmp_path):
    """Who knows the truth has everything right; what sees nothing misses all that is met."""
    scored = "task.scored=true", "task.films=false", "task.workers=1"
    right = run(config(tmp_path, *scored, "perception=truth"), out=f"{tmp_path}/right")
    looks_on = run(
        config(tmp_path, *scored, "perception=all_free", "task.looks_on=true"),
        out=f"{tmp_path}/looks_on",
    )
    changed = ["perception"]
    assert looks_on.drop(columns=changed).equals(right.drop(columns=changed))

    for flight in right["flight"]:
        true, free = (
            Counts.read(tmp_path / folder / "frames" / f"{flight}.npz")
            for folder in ("right", "looks_on")
        )
        assert true.clips == [f"{flight}@{second}" for second in range(len(true.clips))]
        assert not true.scored_on_other(free)
        assert set(true.frames[:-1]) == {5}
        assert float(true.scores("occupancy")["kar_miou"]) == 1.0
        assert float(free.scores("occupancy")["kar_miou"]) == 0.0
        assert float(free.scores("safety")["false_free_rate"]) == 1.0
        assert float(true.scores("plans")["plan_regret"]) == 0.0


def test_the_flights_that_are_drawn_follow_a_rule():
    columns = ("flight", "outcome", "clearance_m")
    rows = [("a", "arrived", 1.0), ("b", "collided", 0.2), ("c", "arrived", 0.6)]
    rows += [("d", "collided", 0.1), ("e", "arrived", 2.0)]
    table = pd.DataFrame(rows, columns=columns)
    assert films_of(table) == {"collision": "b", "close_call": "c", "clean": "e"}
    assert films_of(table[:1]) == {"close_call": "a"}
    assert films_of(table[1:2]) == {"collision": "b"}


def test_the_truth_reaches_as_far_as_the_grid_of_the_predictions(tmp_path):
    row = ROW | {"y_m": 9.0, "length_m": 20.0, "height_m": 12.0}
    reach_m = []
    for upper_m in (25.0, 50.0):
        grid = f"task.grid.upper_m=[{upper_m},12.5,5]", f"task.grid.shape=[{2 * upper_m:.0f},50,30]"
        stage, _ = Campaign(plain(tmp_path, *grid)).flown_by_truth(Job.of(row))
        reach_m.append(stage.truth.static.points_m[:, 0].max() - row["length_m"] - row["x_m"])
    assert reach_m[1] > 60 > 46 > reach_m[0] > 40


def test_a_mission_through_a_wall_is_refused(tmp_path):
    path = tmp_path / "missions.csv"
    pd.DataFrame([ROW]).to_csv(path, index=False)
    with pytest.raises(UserError, match=r"task.missions: .*yard-0/000 begins or ends in a wall"):
        run(config(tmp_path), missions=str(path))
    pd.DataFrame([ROW]).drop(columns="yaw_rad").to_csv(path, index=False)
    with pytest.raises(UserError, match="has no column yaw_rad"):
        run(config(tmp_path), missions=str(path))
    with pytest.raises(UserError, match="no file"):
        run(config(tmp_path), missions=f"{tmp_path}/none.csv", out=f"{tmp_path}/out")


@pytest.mark.parametrize(
    ("column", "value", "match"),
    [
        ("x_m", "", "row 2; give numbers"),
        ("truth_s", 0.0, "row 2; give numbers"),
        ("seed", 1.5, "row 2; give numbers"),
        ("index", 0, "row 2; .* each town, seed and index once"),
        ("weather", "hail", "there is no 'hail'"),
    ],
)
def test_missions_that_are_not_sound_are_refused(column, value, match, tmp_path):
    pd.DataFrame([ROW, ROW | {"index": 1} | {column: value}]).to_csv(
        path := tmp_path / "missions.csv", index=False
    )
    with pytest.raises(UserError, match=match):
        run(config(tmp_path), missions=str(path))
    path.write_bytes(b"\xff\x00")
    with pytest.raises(UserError, match=r"missions\.csv is no table"):
        run(config(tmp_path), missions=str(path))


def test_a_flight_that_never_began_bars_no_other(tmp_path):
    """The settings of a command that failed stay with it."""
    with pytest.raises(UserError, match="no file"):
        run(config(tmp_path), missions=f"{tmp_path}/none.csv", out=f"{tmp_path}/out")
    with pytest.raises(UserError, match="no file"):
        run(
            config(tmp_path, "planner.threshold=0.3"),
            missions=f"{tmp_path}/no.csv",
            out=f"{tmp_path}/out",
        )


def test_a_map_with_no_route_in_conflict_is_refused(tmp_path):
    """Within 2.5 m of the corridor there is neither wall nor wire at these heights."""
    near = "mission.offset_m=[0.5,0.6]", "mission.height_m=[2.5,3.0]", "mission.tries=2"
    campaign = Campaign(plain(tmp_path, *near))
    with pytest.raises(UserError, match=r"mission: no route of tests.loop.yard-100 .* 2 tried"):
        campaign.choose("tests.loop.yard", 100)


@pytest.mark.parametrize(
    ("overrides", "match"),
    [
        (["task.rules.plan_hz=10.0"], "task.rules.plan_hz: 10.0; the camera"),
        (["task.rules.plan_hz=3.0"], "task.rules.plan_hz: 3.0 does not divide"),
        (["task.rules.late_s=0.0"], "task.rules.late_s"),
        (["mission.offset_m=[6,0.5]"], r"mission.offset_m: \[6, 0.5\]; give two numbers"),
        (["mission.height_m=[-3,1]"], "mission.height_m"),
        (["mission.weathers=[hail]"], "there is no 'hail'"),
        (["task.grid.shape=[50,50]"], "grid.shape: .* give three numbers"),
        (["mission.conflict=0", "mission.clear=0"], "leaves no flight"),
        (["planner.unknown=maybe"], "planner.unknown"),
        (["perception=learned"], "ckpt_path: this perception needs a checkpoint"),
        (["perception=faulty"], "ckpt_path: this perception needs a checkpoint"),
        (["perception=all_free", "perception.occupied=2"], "perception.occupied"),
    ],
)
def test_mistakes_are_told_in_one_line(overrides, match, tmp_path):
    with pytest.raises((UserError, InstantiationException)) as error:
        Campaign(plain(tmp_path, *overrides))
    assert re.search(match, one_line(error.value))
    assert "\n" not in one_line(error.value)
