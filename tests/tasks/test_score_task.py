"""task=score and task=compare as their user meets them."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.predictions import PredictionWriter
from src.data.truth import SkyShieldTruth
from src.errors import UserError
from src.metrics.tally import Tally
from src.ontology import BUILDING, CLASSES, FREE, UNKNOWN
from src.report.results import read_results
from src.tasks.compare import compare
from src.tasks.score import score
from tests.synthetic import compose_config, mini_overrides, write_dataset

FEW = ("suite.resamples=20", "suite.rays=[10,6]")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    return write_dataset(compose_config(*mini_overrides(folder)))


def write_predictions(dataset, folder, change=lambda labels: labels, facts=None, part="test"):
    """The truth itself, free where it is unknown, after a change."""
    source = SkyShieldTruth(dataset, part)
    with PredictionWriter(folder, facts or {"name": folder.name}) as writer:
        for clip, frame in source.samples:
            labels = source.truth(clip, frame)["semantics"][0]
            writer.add(clip, frame, change(torch.where(labels == UNKNOWN, FREE, labels).byte()))
    return folder


def config_for(dataset, predictions, *more):
    words = ("task=score", f"predictions={predictions}", f"dataset={dataset}", *FEW, *more)
    return compose_config(*mini_overrides(dataset.parent), *words)


def scored(dataset, predictions, *more, part="test", allow_missing=False):
    score(config_for(dataset, predictions, *more), part, allow_missing, None)
    return predictions / "scores"


def without_buildings(labels):
    return torch.where(labels == BUILDING, FREE, labels).byte()


def test_the_truth_scores_one(dataset, tmp_path):
    folder = scored(dataset, write_predictions(dataset, tmp_path / "perfect"))
    rows = read_results(folder / "results.csv")
    assert list(rows["split"]) == ["test", "test_unseen_clips", "test_seen_clips"]
    assert (rows[["miou", "miou_occupied", "kar_miou"]] == 1).all(axis=None)
    table = pd.read_csv(folder / "scores.csv").set_index(["split", "score"])["value"]
    assert table["test", "geometric_iou"] == table["test", "ray_iou"] == 1
    assert table["test", "false_free_rate"] == 0
    protocols = pd.read_csv(folder / "protocols.csv").set_index("protocol")["score"]
    assert protocols["KAR-mIoU"] == 1
    assert protocols["the same, an absent class counts as 0"] < 1


def test_what_is_lost_is_seen_by_every_table(dataset, tmp_path):
    folder = scored(dataset, write_predictions(dataset, tmp_path / "blind", without_buildings))
    row = read_results(folder / "results.csv").iloc[0]
    assert row["iou/building"] == 0
    assert row["kar_miou"] < row["miou"] < 1
    parts = pd.read_csv(folder / "breakdown.csv").set_index(["scope", "part", "class"])
    assert parts.loc[("all", "whole", "building"), "kar_iou"] == 0
    assert parts.loc[("all", "whole", "ground"), "iou"] == 1


def test_another_part_and_the_visible_voxels_have_their_own_protocol(dataset, tmp_path):
    predictions = write_predictions(dataset, tmp_path / "val", part="val")
    folder = scored(dataset, predictions, "layout.mask=visible", part="val")
    rows = read_results(folder / "results.csv")
    assert list(rows["split"]) == ["val"]
    assert '"mask":"visible voxels"' in rows["protocol"][0]
    assert '"part":"val"' in rows["protocol"][0]


def drop_a_frame(folder):
    path = next(folder.rglob("occupancy.npz"))
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files[1:]}
    np.savez_compressed(path, **arrays)


def cut_a_file(folder):
    path = next(folder.rglob("occupancy.npz"))
    path.write_bytes(path.read_bytes()[:-50])


@pytest.mark.parametrize(("damage", "word"), [(drop_a_frame, "missing"), (cut_a_file, "corrupt")])
def test_a_damaged_folder_is_scored_only_when_told_so(dataset, tmp_path, damage, word):
    predictions = write_predictions(dataset, tmp_path / "mine")
    damage(predictions)
    with pytest.raises(UserError, match=f"1 {word}: .*task.allow_missing=true") as error:
        scored(dataset, predictions)
    assert str(error.value).startswith(str(predictions))
    assert not (predictions / "scores").exists()
    folder = scored(dataset, predictions, allow_missing=True)
    tally = Tally.read(folder / "tallies" / "mine.npz")
    assert tally.protocol.frames == sum(tally.frames) < len(SkyShieldTruth(dataset).samples)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["layout.mask=lidar"], "^layout.mask: 'lidar'"),
        (["layout=occ3d"], "^layout.velocity_mps: "),
        (["layout=occ3d", "layout.velocity_mps=[8,0,0]", "layout.grid=null"], "^layout.grid: "),
        (["layout=occ3d", "layout.velocity_mps=[8,0,0]"], "holds no <scene>/<token>"),
        (["predictions=null"], "^predictions: name the folder"),
    ],
)
def test_what_cannot_be_scored_is_one_clear_error(dataset, tmp_path, words, message):
    predictions = write_predictions(dataset, tmp_path / "mine")
    with pytest.raises(UserError, match=message):
        scored(dataset, predictions, *words)


def test_predictions_of_another_data_set_are_refused(dataset, tmp_path):
    facts = {"name": "mine", "dataset": "paper-0123"}
    predictions = write_predictions(dataset, tmp_path / "mine", facts=facts)
    with pytest.raises(UserError, match="predictions of paper-0123, not of"):
        scored(dataset, predictions)


def test_occ3d_folders_are_scored_in_our_classes(dataset, tmp_path):
    rng = np.random.default_rng(0)
    theirs = rng.integers(0, 18, (5, 4, 3)).astype(np.uint8)
    seen = rng.random((5, 4, 3)) < 0.5
    wrong = np.where(seen, theirs, 17 - theirs).astype(np.uint8)
    for folder, semantics in (("gts", theirs), ("mine", wrong)):
        path = tmp_path / folder / "scene-0001" / "token" / "labels.npz"
        path.parent.mkdir(parents=True)
        np.savez(path, semantics=semantics, mask_camera=seen, mask_lidar=seen)
    grid = "layout.grid={lower_m:[0,-4,-3],upper_m:[10,4,3],shape:[5,4,3]}"
    words = ("layout=occ3d", grid, "layout.velocity_mps=[8,0,0]")
    folder = scored(tmp_path / "gts", tmp_path / "mine", *words)
    rows = read_results(folder / "results.csv").iloc[0]
    assert rows["kar_miou"] == 1  # wrong only where the camera does not see
    assert "velocity_mps" in rows["protocol"]
    everywhere = scored(tmp_path / "gts", tmp_path / "mine", *words, "layout.mask=supervised")
    assert read_results(everywhere / "results.csv").iloc[0]["kar_miou"] < 0.9


@pytest.fixture
def runs(dataset, tmp_path):
    perfect = write_predictions(dataset, tmp_path / "perfect")
    blind = write_predictions(dataset, tmp_path / "blind", without_buildings)
    return [str(scored(dataset, each)) for each in (blind, perfect)]


def test_two_runs_are_compared_by_the_same_draws(dataset, runs, tmp_path):
    cfg = config_for(dataset, "none")
    compare(cfg, runs, str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out" / "differences.csv").set_index(["run", "score"])
    better = table.loc[("perfect", "kar_miou")]
    assert better["minus blind"] == pytest.approx(
        better["value"] - table.loc["blind", "value"]["kar_miou"]
    )
    # One of the two clips shows no building: drawn twice, it tells the runs apart in nothing.
    assert 0 <= better["difference_low"] < better["difference_high"]
    assert 0.5 < better["same_sign"] < 1
    ranks = pd.read_csv(tmp_path / "out" / "sensitivity.csv")
    assert len(ranks) == 81
    assert (ranks["rank perfect"] == 1).all()
    assert (tmp_path / "out" / "sensitivity.png").stat().st_size > 10_000


def test_other_protocols_are_not_compared(dataset, runs, tmp_path):
    other = write_predictions(dataset, tmp_path / "other")
    folder = scored(dataset, other, "metric.horizon_s=4.0")
    with pytest.raises(UserError, match=r"^other: was scored with metric.horizon_s=4.0, and blind"):
        compare(config_for(dataset, "none"), [runs[0], str(folder)], str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_other_frames_of_the_same_clips_are_not_compared(dataset, runs, tmp_path):
    (path,) = Path(runs[1]).glob("tallies/perfect.npz")
    tally = Tally.read(path)
    first, second = tally.frames
    dataclasses.replace(tally, frames=[first - 1, second + 1]).write(path)
    with pytest.raises(UserError, match=r"^perfect: has other clips or frames than blind; score"):
        compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))


def test_runs_of_one_name_are_told_apart_by_their_folders(dataset, tmp_path):
    runs = []
    for seed in (0, 1):
        facts = {"name": "skyocc", "seed": seed}
        folder = write_predictions(dataset, tmp_path / f"seed{seed}" / "test", facts=facts)
        runs.append(str(scored(dataset, folder)))
    compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out" / "differences.csv")
    assert set(table["run"]) == {"skyocc seed0", "skyocc seed1"}


def test_a_comparison_of_some_clips_is_of_these_alone(dataset, runs, tmp_path, capsys):
    tallies = [Tally.read(next(Path(run).glob("tallies/*.npz"))) for run in runs]
    clip = tallies[0].clips[1]
    for name, tally in zip("ab", tallies):
        tally.of_clips(lambda each: each == clip).write(tmp_path / f"{name}.npz")
    alone = [str(tmp_path / f"{name}.npz") for name in "ab"]
    cfg = config_for(dataset, "none")
    compare(cfg, runs, str(tmp_path / "some"), [f"{clip[:-1]}?", clip])
    printed = " ".join(capsys.readouterr().out.split())
    assert "intervals over 1 clip," in printed
    assert "nan" not in printed
    compare(cfg, alone, str(tmp_path / "alone"))
    compare(cfg, runs, str(tmp_path / "all"), ["*"])
    some, one, whole = (
        pd.read_csv(tmp_path / name / "differences.csv") for name in ("some", "alone", "all")
    )
    pd.testing.assert_frame_equal(some, one)
    assert not some["value"].equals(whole["value"])


def with_every_other_slice(labels):
    return torch.where(torch.arange(len(labels))[:, None, None] % 2 > 0, labels, FREE).byte()


def test_what_rounding_alone_tells_apart_shares_a_rank(dataset, tmp_path):
    half = write_predictions(dataset, tmp_path / "half", with_every_other_slice)
    first = scored(dataset, half) / "tallies" / "half.npz"
    tally = Tally.read(first)
    excess = tally.tables["sensitivity"]["excess"]
    excess += excess > 0  # the least step of these fixed-point numbers
    tally.write(tmp_path / "again.npz")
    runs = [str(first), str(tmp_path / "again.npz")]
    compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))
    ranks = pd.read_csv(tmp_path / "out" / "sensitivity.csv").filter(like="rank")
    assert ranks.shape == (81, 2)
    assert (ranks == 1).all(axis=None)


def test_clips_that_nothing_is_like_are_refused(dataset, runs, tmp_path):
    with pytest.raises(UserError, match=r"^task.clips: no scored clip is like 'town/x'; there are"):
        compare(config_for(dataset, "none"), runs, str(tmp_path / "out"), ["*", "town/x"])
    assert not (tmp_path / "out").exists()


def test_a_comparison_needs_two_runs_that_are_there(dataset, runs, tmp_path):
    cfg = config_for(dataset, "none")
    with pytest.raises(UserError, match=r"^task.runs: name two or more"):
        compare(cfg, runs[:1], str(tmp_path))
    with pytest.raises(UserError, match=r"^task.runs: .*nowhere is neither"):
        compare(cfg, [*runs, str(tmp_path / "nowhere")], str(tmp_path))
    with pytest.raises(UserError, match="holds 0 scored runs"):
        compare(cfg, [*runs, str(tmp_path)], str(tmp_path))


def test_every_class_has_a_row_in_every_part(dataset, tmp_path):
    folder = scored(dataset, write_predictions(dataset, tmp_path / "perfect"))
    parts = pd.read_csv(folder / "breakdown.csv")
    assert set(parts["class"]) == set(CLASSES)
    assert (parts.groupby(["scope", "part"]).size() == len(CLASSES)).all()
