"""task=flights: perceptions side by side, thresholds as a curve, mistakes in one line."""

import shutil

import pandas as pd
import pytest
from PIL import Image

from src.errors import UserError
from src.tasks.flights import flights
from tests.results.test_flight_scores import table
from tests.synthetic import sound_config


def write(folder, outcomes, perception, threshold=0.5, **columns):
    folder.mkdir(parents=True)
    flown = table(outcomes, perception).assign(**columns)
    flown.to_csv(folder / "flights.csv", index=False)
    (folder / "config.yaml").write_text(f"planner: {{threshold: {threshold}}}\n")
    return str(folder)


def run(tmp_path, folders, reference="seen", perceptions=()):
    cfg = sound_config("task=flights")
    flights(cfg, folders, reference, 50, str(tmp_path / "out"), perceptions)
    return pd.read_csv(tmp_path / "out" / "scores.csv")


@pytest.fixture
def seen(tmp_path):
    return write(tmp_path / "seen", ["arrived"] * 3, "seen")


def test_a_perception_is_compared_with_the_reference(tmp_path, seen, capsys):
    model = write(tmp_path / "model", ["arrived", "collided", "arrived"], "model")
    scores = run(tmp_path, [seen, model]).set_index(["perception", "stratum", "score"])
    assert scores.loc[("model", "all", "excess_collisions"), "value"] == pytest.approx(1 / 3)
    assert set(scores["recipe"]) == {"unknown"}, "of tables from before there were recipes"
    assert not (tmp_path / "out" / "thresholds.png").exists()
    assert "+33.3" in capsys.readouterr().out


def test_the_recipe_of_what_flew_is_a_column(tmp_path, capsys):
    seen = write(tmp_path / "seen", ["arrived"] * 3, "seen", recipe="none")
    flown = ["arrived", "collided", "arrived"]
    models = [write(tmp_path / name, flown, name, recipe=name) for name in ("strong", "paper")]
    scores = run(tmp_path, [seen, *models]).groupby("perception")["recipe"].agg(set)
    assert scores.to_dict() == {"seen": {"none"}, "strong": {"strong"}, "paper": {"paper"}}
    assert "Recipe" in capsys.readouterr().out
    run(tmp_path, [seen, models[0]])
    assert "maps; recipe strong" in capsys.readouterr().out


def test_one_that_flew_with_several_thresholds_is_a_curve(tmp_path, seen):
    bold = write(tmp_path / "bold", ["arrived", "collided", "arrived"], "model", 0.7)
    careful = write(tmp_path / "careful", ["arrived", "stuck", "arrived"], "model", 0.3)
    scores = run(tmp_path, [seen, bold, careful])
    assert set(scores["perception"]) == {"seen", "model at 0.7", "model at 0.3"}
    with Image.open(tmp_path / "out" / "thresholds.png") as picture:
        assert picture.width > 500


@pytest.fixture
def seeds(tmp_path):
    of_seed = {0: ["arrived", "collided", "arrived"], 1: ["collided", "collided", "arrived"]}
    for seed, outcomes in of_seed.items():
        write(tmp_path / f"all/learned/m-seed{seed}/flown", outcomes, f"m-seed{seed}")
    return tmp_path / "all"


def test_the_seeds_of_a_model_are_one_perception(tmp_path, seen, seeds):
    both = run(tmp_path, [seen, str(seeds)])
    values = both.set_index(["perception", "stratum", "score"])["value"]
    assert values["m", "all", "excess_collisions"] == pytest.approx(0.5)

    shutil.rmtree(seeds / "learned/m-seed1")
    [alone] = {*run(tmp_path, [seen, str(seeds)])["perception"]} - {"seen"}
    assert alone == "m-seed0"


def test_a_published_table_is_read_as_the_folders_were(tmp_path, seen, seeds):
    paths = [tmp_path / "seen/flights.csv", *sorted(seeds.rglob("flights.csv"))]
    tables = [pd.read_csv(path) for path in paths]
    tables = [each.assign(name=each["perception"], frames="flown") for each in tables]
    # Not of this comparison: frames of another UAV's flights, and flights of another threshold.
    others = [tables[0].assign(frames="verge"), tables[1].assign(name="m-seed0_at_0.3")]
    thresholds = [*(each.assign(threshold=0.5) for each in tables)]
    thresholds += [each.assign(threshold=t) for each, t in zip(others, (0.5, 0.3))]
    pd.concat(thresholds).to_csv(path := tmp_path / "flights.csv.xz", index=False)

    chosen = run(tmp_path, [str(path)], perceptions=["seen", "m-seed?"])
    assert chosen.equals(run(tmp_path, [seen, str(seeds)]))
    assert "m-seed0 at 0.3" in set(
        run(tmp_path, [str(path)], perceptions=["s*", "*seed0*"])["perception"]
    )


def test_mistakes_are_told_in_one_line(tmp_path, seen):
    with pytest.raises(UserError, match="name a folder or more"):
        run(tmp_path, [])
    with pytest.raises(UserError, match=r"seen at 0\.5 is there twice"):
        run(tmp_path, [seen, seen])
    with pytest.raises(UserError, match=r"has no flights.csv; make it by task=fly"):
        run(tmp_path, [str(tmp_path)])
    with pytest.raises(UserError, match=r"task.perceptions: none is called 'sean'; .* seen"):
        run(tmp_path, [seen], perceptions=["sean"])
    (tmp_path / "runs.tar.xz").write_bytes(b"PK")
    with pytest.raises(UserError, match=r"runs.tar.xz is no table .* python -m tarfile -e"):
        run(tmp_path, [str(tmp_path / "runs.tar.xz")])
    flown = pd.read_csv(tmp_path / "seen/flights.csv", keep_default_na=False)
    wrong = {"outcome": "crashed", "time_s": 0.0, "truth_s": "", "clearance_m": "near"}
    for column, value in wrong.items():
        one = flown.astype({column: object})
        one.loc[0, column] = value
        one.to_csv(tmp_path / "flights.csv", index=False)
        with pytest.raises(UserError, match=r"flights\.csv is no table of flights"):
            run(tmp_path, [str(tmp_path)])
    flown.to_csv(tmp_path / "flights.csv", index=False)
    with pytest.raises(UserError, match=r"config.yaml: lacks planner.threshold"):
        run(tmp_path, [str(tmp_path)])
    with pytest.raises(UserError, match=r"has no column frames; .* give the folder"):
        run(tmp_path, [str(tmp_path / "flights.csv")])
    again = write(tmp_path / "again", ["arrived"] * 3, "seen", 0.3)
    with pytest.raises(UserError, match=r"name one of seen at 0\.5, seen at 0\.3"):
        run(tmp_path, [seen, again])
    run(tmp_path, [seen, again], reference="seen at 0.5")
