"""The guarantee holds on exchangeable maps, and what cannot give one is refused."""

import numpy as np
import pandas as pd
import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics.protocol import SUPERVISED, Protocol
from src.results.counts import Counts
from studies.uncertainty import conformal
from studies.uncertainty.conformal import change_of, controlled, free_of, halves, losses_of, main


def drawn(maps, shift=0.0, seed=0):
    """Maps whose objects warn at some level; a shift makes all warnings weaker."""
    rng, found = np.random.default_rng(seed), {}
    for n in range(maps):
        middle = rng.normal(120 - shift, 15)
        levels = np.clip(rng.normal(middle, 20, 30), 0, 201).astype(int)
        free = np.clip(rng.normal(40, 20, 500), 0, 201).astype(int)
        found[f"park-{n}"] = np.stack([np.bincount(each, minlength=202) for each in (levels, free)])
    return found


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.3])
def test_new_maps_lose_no_more_than_was_promised(alpha):
    losses = []
    for seed in range(60):
        level = controlled(losses_of(drawn(40, seed=2 * seed)), alpha)
        losses.append(losses_of(drawn(40, seed=2 * seed + 1))[:, level].mean())
    assert np.mean(losses) <= alpha
    assert np.mean(losses) > alpha - 0.06


def test_where_warnings_are_weaker_the_promise_breaks():
    level = controlled(losses_of(drawn(40)), 0.1)
    assert losses_of(drawn(40, shift=40.0, seed=1))[:, level].mean() > 0.2


def test_the_change_is_that_of_the_maps_of_both():
    own = drawn(40)
    level = controlled(losses_of(own), 0.1)
    weaker = dict([*drawn(40, shift=40.0).items()][:12])
    change = change_of(weaker, own, level)
    same = {name: own[name] for name in weaker}
    means = [losses_of(each)[:, level].mean() for each in (same, weaker)]
    assert change["change"] == pytest.approx(means[0] - means[1])
    assert change["change_low"] < change["change"] < change["change_high"] < 0
    assert change_of(own, own, level)["change_low"] == 0
    assert change_of(own, {}, level) == {}


def test_towns_that_were_never_seen_stand_apart(tmp_path, monkeypatch):
    """A command line gives a list of them."""
    own = drawn(20) | {f"fair-{n}": each for n, each in enumerate(drawn(3, seed=1).values())}
    read = own, {"a flight": Protocol.of("sky", "flights", 1, VoxelGrid(), SUPERVISED, {}, {})}
    monkeypatch.setattr(conformal, "read_maps", lambda folder: read)
    main("flights", unseen=["fair"], out=tmp_path / "table.csv")
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["maps"].tolist() == ["100 halves", "all", "unseen towns"]
    assert table["tested"].tolist() == [10, 20, 3]
    with pytest.raises(UserError, match=r"--unseen: there is no fairr; there are fair, "):
        main("flights", unseen=["fairr"], out=tmp_path / "table.csv")


def test_flights_of_any_length_are_read_and_those_of_other_settings_refused(tmp_path):
    (tmp_path / "config.yaml").write_text("task: {looks_on: true}")
    occupied = {"objects": torch.ones(1, 202, dtype=int), "tube": torch.ones(1, 202, 4, dtype=int)}

    def write(number, frames, metric):
        protocol = Protocol.of("sky", "flights", frames, VoxelGrid(), SUPERVISED, metric, {})
        path = tmp_path / f"frames/park-{number}/000.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        Counts("mine", protocol, ["000"], [frames], {"occupied": occupied}).write(path)

    for number in range(20):
        write(number, frames=50 + number, metric={})
    main(str(tmp_path), alpha=0.9, out=tmp_path / "table.csv")
    assert pd.read_csv(tmp_path / "table.csv")["objects"].tolist() == [10 * 202, 20 * 202]

    write(3, frames=53, metric={"gamma": 2.0})
    with pytest.raises(UserError, match=r"park-3/000\.npz: was scored with metric\.gamma=2\.0"):
        main(str(tmp_path), alpha=0.9, out=tmp_path / "table.csv")


def test_flights_that_the_perception_flew_itself_are_refused(tmp_path):
    (tmp_path / "config.yaml").write_text("task: {looks_on: false}")
    with pytest.raises(UserError, match=r"not flown with task\.looks_on=true"):
        main(str(tmp_path))


def test_the_threshold_is_the_largest_one_that_keeps_the_promise():
    losses = np.tile([0.0, 0.02, 0.05, 0.2, 1.0], (19, 1))
    assert controlled(losses, 0.1) == 2
    assert controlled(losses, 0.0501) == 0


def test_an_object_is_missed_below_the_threshold_and_not_at_it():
    found = np.zeros((2, 5), int)
    found[0, 3], found[1, 1] = 2, 4
    assert losses_of({"park-1": found}).tolist() == [[0, 0, 0, 0, 1]]
    assert free_of({"park-1": found}).tolist() == [0, 0, 1, 1, 1]
    assert (losses_of({"park-1": np.zeros((2, 5), int)}) == 0).all()


def test_halves_of_exchangeable_maps_cover_what_was_wanted():
    row = halves(drawn(200), 0.1)
    assert 0.88 < row["coverage"] < 0.92


@pytest.mark.parametrize(
    ("losses", "alpha", "told"),
    [
        (np.zeros((8, 3)), 0.1, "needs 9 maps or more, and here are 8"),
        (np.zeros((50, 3)), 0.0, "between 0 and 1"),
        (np.zeros((50, 3)), 1.0, "between 0 and 1"),
        (np.full((50, 3), np.nan), 0.1, "NaN"),
    ],
)
def test_what_can_promise_nothing_is_refused(losses, alpha, told):
    with pytest.raises(UserError, match=told):
        controlled(losses, alpha)
