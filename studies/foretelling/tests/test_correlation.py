"""Correlations of scores with collisions: by hand, and of perceptions whose order is known."""

import math
import shutil

import numpy as np
import pandas as pd
import pytest
import torch

from src.errors import UserError
from studies.foretelling.correlation import (
    FlownPerception,
    _drawn,
    counts_by_map,
    foretelling,
    kendall,
    spearman,
)
from studies.foretelling.foreseeing import foreseen
from studies.foretelling.windows import windows_of
from tests.results.flown import write_flown

SCORES = {"miou_occupied": "high", "kar_miou": "high", "geometric_iou": "high"}
SCORES |= {"false_free_rate": "low", "object_miss_rate": "low"}


def generator():
    return torch.Generator().manual_seed(0)


def tables_of(root, scores=SCORES, resamples=5):
    """The table of correlations by what they are of, and that of the perceptions."""
    perceptions = FlownPerception.all_below([root])
    found = foretelling(perceptions, "seen", scores, "kar_miou", resamples, generator())
    return found[0].set_index(["frames", "stratum", "target", "score"]).sort_index(), found[1]


# ------------------------------------------------------------------------------------ by hand


def test_spearman_is_that_of_pandas_where_there_is_one_block():
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 6, (5, 12)).astype(float), rng.normal(size=(5, 12))
    found = spearman(x, y, np.zeros(12))
    for row in range(5):
        table = pd.DataFrame({"x": x[row], "y": y[row]})
        assert found[row] == pytest.approx(table.corr(method="spearman").loc["x", "y"])


def test_a_block_that_is_better_as_a_whole_makes_no_correlation():
    """Within the blocks the order is the opposite."""
    x = np.array([[1.0, 2.0, 3.0, 11.0, 12.0, 13.0]])
    y = np.array([[3.0, 2.0, 1.0, 13.0, 12.0, 11.0]])
    blocks = np.array(["a", "a", "a", "b", "b", "b"])
    assert spearman(x, y, blocks)[0] == pytest.approx(-1.0)
    assert spearman(x, y, np.zeros(6))[0] > 0.5


def test_what_is_missing_is_left_out():
    x = np.array([[1.0, math.nan, 2.0, 3.0]])
    y = np.array([[1.0, 9.0, 2.0, 3.0]])
    assert spearman(x, y, np.zeros(4))[0] == pytest.approx(1.0)
    assert math.isnan(spearman(np.ones((1, 4)), y, np.zeros(4))[0])
    assert kendall(x[0], y[0], np.zeros(4)) == 1.0


def test_kendall_counts_pairs_and_ties():
    """Of six pairs one is tied in the second and one is the wrong way round; of blocks there are
    two pairs."""
    first, second = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 3.0, 2.0, 3.0])
    one, two = np.zeros(4), np.array([0, 0, 1, 1])
    assert kendall(first, second, one) == pytest.approx((4 - 1) / math.sqrt(6 * 5))
    assert kendall(first, -second, two) == -1.0
    assert math.isnan(kendall(first, np.zeros(4), one))


# ----------------------------------------------------------------------------- perceptions


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """The fewer voxels are right, the more flights collide, but for the seen, which hit one too."""
    root = tmp_path_factory.mktemp("flight")
    write_flown(root, "seen", 1.0, lambda m, n: m == n == 0, "anchors")
    for k, right in enumerate((0.9, 0.75, 0.6, 0.45)):
        few = lambda m, n, k=k: 2 * m + n <= k  # noqa: E731
        before = 0.1 if k > 1 else None
        write_flown(root, f"noisy{k}", right, few, sets=("flown", "verge"), before=before)
    return root


def test_scores_that_order_perceptions_as_their_flights_do_have_correlation_one(root):
    table, _ = tables_of(root, resamples=50)
    assert set(table.index.get_level_values("frames")) == {"flown", "verge"}
    for score in ("miou_occupied", "kar_miou", "geometric_iou", "false_free_rate"):
        row = table.loc[("verge", "damaged", "collisions", score)]
        assert (row["spearman"], row["kendall"]) == pytest.approx((1.0, 1.0))
        assert row["perceptions"] == 4
        assert row["low"] > 0
    assert math.isnan(table.loc[("verge", "damaged", "stuck", "kar_miou"), "spearman"])
    same = table.loc[("verge", "damaged", "collisions", "miou_occupied")]
    assert (same["difference"], same["p"]) == (0.0, 1.0)
    assert math.isnan(table.loc[("verge", "damaged", "collisions", "kar_miou"), "difference"])


def test_the_perceptions_stand_with_their_scores_and_collisions(root):
    """Of six flights as many as one says, less the one of the reference."""
    _, table = tables_of(root)
    assert list(table.columns[:4]) == ["frames", "stratum", "perception", "collisions"]
    verge = table[table["frames"] == "verge"].set_index("perception")
    assert list(verge.index) == ["noisy0", "noisy1", "noisy2", "noisy3"]
    assert list(verge["collisions"]) == pytest.approx([0.0, 1 / 6, 2 / 6, 3 / 6])
    assert verge["kar_miou"].is_monotonic_decreasing
    counts = counts_by_map(root / "damaged/noisy2/verge/frames")
    wanted = next(each for m in counts.tables if (each := counts.scores(m).get("kar_miou")))
    assert verge.loc["noisy2", "kar_miou"] == pytest.approx(float(wanted))


def test_the_better_end_of_a_score_decides_the_sign(root):
    table, _ = tables_of(root, SCORES | {"false_free_rate": "high"})
    assert table.loc[("flown", "damaged", "collisions", "false_free_rate"), "spearman"] == -1.0


def test_collisions_of_the_reference_are_no_one_elses(root, tmp_path):
    """Where all hit what it hits, and no more, there is nothing to foretell."""
    write_flown(tmp_path, "seen", 1.0, lambda m, n: n == 0, "anchors")
    for k in range(3):
        write_flown(tmp_path, f"n{k}", 0.9 - 0.2 * k, lambda m, n: n == 0)
    table, _ = tables_of(tmp_path)
    assert table.xs("collisions", level="target")["spearman"].isna().all()


def foreseen_by(root, *names, scores=SCORES):
    perceptions = FlownPerception.all_below([root])
    seen = next(each.flights for each in perceptions if each.name == "seen")
    kept = [each for each in perceptions if each.name in names]
    windows = {each.name: windows_of(each.windows, scores) for each in kept}
    table = foreseen(kept, windows, seen, scores, 50, generator())
    return table.set_index(["control", "score"]).sort_index()


def test_the_seconds_before_a_collision_are_told_from_others(root):
    """Where the prediction was worse right before, it is told from that of the same flight before,
    and from those of who arrived; the flight that the reference does not complete is left out."""
    table = foreseen_by(root, "noisy1", "noisy3")
    assert set(table["collisions"]) == {1 + 3}
    kar = table.loc[("earlier", "kar_miou")]
    assert (kar["compared"], kar["auroc"]) == (4, (0.5 + 3) / 4)
    # On the one mission of noisy1's both collided.
    kar = table.loc[("others", "kar_miou")]
    assert (kar["compared"], kar["auroc"]) == (2, 1.0)


def test_a_worse_perception_is_told_from_a_better_one_and_not_from_itself(root):
    table = foreseen_by(root, "noisy0", "noisy1")
    assert table.loc[("others", "kar_miou"), "auroc"] == 1.0
    assert table.loc[("earlier", "kar_miou"), "auroc"] == 0.5
    # Without a flight that arrived there is nothing to compare with.
    row = foreseen_by(root, "noisy1").loc[("others", "kar_miou")]
    assert (row["collisions"], row["compared"]) == (1, 0)
    assert math.isnan(row["auroc"])


def test_what_never_has_anything_to_count_is_chance_over_the_same_collisions(root):
    """No frame here is clear of obstacles, so that nobody could stop for nothing."""
    scores = {"kar_miou": "high", "phantom_stop_rate": "low"}
    table = foreseen_by(root, "noisy0", "noisy3", scores=scores)
    for control, count in (("others", 3), ("earlier", 3)):
        row = table.loc[(control, "phantom_stop_rate")]
        assert (row["compared"], row["auroc"]) == (count, 0.5)
        assert table.loc[(control, "kar_miou"), "compared"] == count


def test_nothing_flown_and_an_absent_reference_are_refused(tmp_path):
    with pytest.raises(UserError, match=r"no <stratum>/<name>/flown/flights.csv there"):
        FlownPerception.all_below([tmp_path])
    write_flown(tmp_path, "mine", 0.9, lambda m, n: False)
    with pytest.raises(UserError, match=r"task.reference: no flights of seen"):
        tables_of(tmp_path)


def test_perceptions_of_several_places_are_put_together_and_none_is_there_twice(root, tmp_path):
    write_flown(tmp_path, "voxels_0.5", 0.9, lambda m, n: False)
    names = [each.name for each in FlownPerception.all_below([tmp_path, root])]
    assert names == [each.name for each in FlownPerception.all_below([root])] + ["voxels_0.5"]
    with pytest.raises(UserError, match=r"task.flights: seen is there twice"):
        FlownPerception.all_below([root, tmp_path, root])
    # Also not in another stratum: scores are known by the name.
    write_flown(tmp_path, "noisy1", 0.9, lambda m, n: False, "faulty")
    with pytest.raises(UserError, match=r"task.flights: noisy1 is there twice"):
        FlownPerception.all_below([tmp_path, root])


def test_perceptions_that_flew_other_missions_are_refused(root, tmp_path):
    shutil.copytree(root, tmp_path / "flight")
    path = tmp_path / "flight/damaged/noisy1/flown/flights.csv"
    whole = pd.read_csv(path)
    # Of other code missions may have the same names.
    for other in (whole[1:], whole.assign(truth_s=12.2)):
        other.to_csv(path, index=False)
        with pytest.raises(UserError, match="noisy1 did not fly the missions of seen"):
            tables_of(tmp_path / "flight")


def test_a_family_is_drawn_as_a_whole():
    """Two seeds of one model come together, and a single one leaves room."""
    places, strata = np.arange(5), np.array(["a", "a", "a", "b", "b"])
    families = np.array(["x", "x", "y", "z", "w"])
    drawn = _drawn(places, strata, families, 200, generator())
    assert drawn["a"].shape == (201, 4)
    assert drawn["a"][0].tolist() == [0, 1, 2, -1]
    assert {tuple(row) for row in drawn["a"].reshape(-1, 2)} == {(0, 1), (2, -1)}
    assert {tuple(row) for row in drawn["b"]} == {(3, 4), (4, 3), (3, 3), (4, 4)}


def test_perceptions_scored_on_other_frames_are_refused(root, tmp_path):
    shutil.copytree(root, tmp_path / "flight")
    path = tmp_path / "flight/damaged/noisy1/verge/frames/town-300/001.npz"
    shutil.copy(path.with_name("000.npz"), path)
    for _ in range(2):
        with pytest.raises(UserError, match=r"noisy1/verge/frames: has other frames than .*noisy0"):
            tables_of(tmp_path / "flight")
        path.unlink(missing_ok=True)


def test_a_score_that_there_is_not_is_told(root):
    with pytest.raises(UserError, match=r"task.scores.mine: no score of .*; there are .*kar_miou"):
        tables_of(root, SCORES | {"mine": "low"})
