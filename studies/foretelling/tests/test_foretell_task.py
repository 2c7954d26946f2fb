"""task=foretell: its files, and mistakes in one line."""

import pandas as pd
import pytest
from PIL import Image

from src.errors import UserError
from studies.foretelling import figure as foretell_figure
from studies.foretelling.figure import draw_standings
from studies.foretelling.task import foretell
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


def test_every_stratum_is_drawn_and_no_axes_are_empty(tmp_path, monkeypatch):
    """Six strata are more than there are colors, six scores do not fill two rows of five."""
    figures = []
    monkeypatch.setattr(foretell_figure, "write_figure", lambda figure, _: figures.append(figure))
    scores = {f"score{n}": "low" if n % 2 else "high" for n in range(6)}
    rows = [{"frames": "verge", "stratum": s, "collisions": 0.1} for s in "abcdef"]
    standings = pd.DataFrame(rows).assign(**dict.fromkeys(scores, 0.5))
    table = pd.DataFrame({"frames": "verge", "stratum": "all", "target": "collisions"}, [0])
    draw_standings(standings, table.assign(score="score0", spearman=0.7), scores, "seen", tmp_path)
    shown = [axes for axes in figures[0].axes if axes.axison]
    assert len(figures[0].axes) == 10
    assert [len(axes.collections) for axes in shown] == [6] * 6
    assert [axes.xaxis_inverted() for axes in shown] == [False, True] * 3
    assert shown[0].get_title() == "score0  +0.70"


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
