"""task=foretell: its files, and mistakes in one line."""

import pandas as pd
import pytest
from PIL import Image

from src.errors import UserError
from src.tasks.foretell import foretell
from tests.results.flown import write_flown
from tests.synthetic import sound_config


def run(tmp_path, *overrides):
    cfg = sound_config("task=foretell", f"paths.runs={tmp_path}", "task.resamples=20", *overrides)
    foretell(cfg, **{key: value for key, value in cfg.task.items() if not key.startswith("_")})
    return tmp_path / "flight"


def test_it_leaves_tables_and_a_picture(tmp_path, capsys):
    root = tmp_path / "flight"
    write_flown(root, "seen", 1.0, lambda m, n: False, "anchors")
    for k in range(3):
        write_flown(root, f"n{k}", 0.9 - 0.2 * k, lambda m, n, k=k: 2 * m + n < k)
    folder = run(tmp_path)
    table = pd.read_csv(folder / "correlations.csv")
    assert "object_miss_rate" in set(table["score"])
    assert len(pd.read_csv(folder / "foreseen.csv")) == 2 * table["score"].nunique()
    assert len(pd.read_csv(folder / "perceptions.csv")) == 3
    for name in ("correlations.png", "perceptions_flown.png"):
        with Image.open(folder / name) as picture:
            assert picture.width > 500
    assert "frames flown, 3 perceptions" in " ".join(capsys.readouterr().out.split())


def test_published_flights_give_the_same_tables(tmp_path):
    root, out = tmp_path / "flight", tmp_path / "again"
    write_flown(root, "seen", 1.0, lambda m, n: False, "anchors")
    for k in range(3):
        few = lambda m, n, k=k: 2 * m + n < k  # noqa: E731
        write_flown(root, f"n{k}", 0.9 - 0.2 * k, few, sets=("flown", "verge"), before=0.3)
    run(tmp_path, "task.publish=true")
    run(tmp_path, f"task.flights=[{root}/flights.zip]", f"task.out={out}", "task.publish=true")
    for name in ("correlations.csv", "perceptions.csv", "foreseen.csv", "flights.zip"):
        assert (out / name).read_bytes() == (root / name).read_bytes()


@pytest.mark.parametrize(
    ("overrides", "match"),
    [
        (["task.against=mine"], "task.against: mine is not in task.scores"),
        (["task.scores.miou=up"], "task.scores.miou: up; say which end is better"),
        ([], "no <stratum>/<name>/flown/flights.csv there"),
    ],
)
def test_mistakes_are_told_in_one_line(overrides, match, tmp_path):
    with pytest.raises(UserError, match=match):
        run(tmp_path, *overrides)
