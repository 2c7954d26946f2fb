"""task=score and task=compare as their user meets them."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.predictions import PredictionWriter
from src.data.truth import SkyShieldTruth
from src.errors import UserError
from src.ontology import BUILDING, CLASSES, FREE, UNKNOWN
from src.results.counts import Counts
from src.results.files import read_results
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
    source = SkyShieldTruth(dataset, part, (facts or {}).get("held_out"))
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
    table = pd.read_csv(folder / "scores.csv").set_index(["part", "score"])["value"]
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
    tally = Counts.read(folder / "tallies" / "mine.npz")
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


def test_predictions_of_another_split_are_scored_by_it(dataset, tmp_path):
    facts = {"name": "mine", "held_out": {"val": [], "test": ["downtown/clip00"]}}
    assert SkyShieldTruth(dataset).unseen == {"suburb/clip00"}
    folder = scored(dataset, write_predictions(dataset, tmp_path / "mine", facts=facts))
    rows = read_results(folder / "results.csv")
    assert list(rows["split"]) == ["test", "test_unseen_clips", "test_seen_clips"]
    assert (rows["miou"] == 1).all()
    tally = Counts.read(folder / "tallies/mine.npz")
    whole, second = (
        tally.frames[tally.clips.index(c)] for c in ("downtown/clip00", "suburb/clip00")
    )
    assert whole > second, "the held-out flight has all of its frames"
    table = pd.read_csv(folder / "scores.csv").drop_duplicates("part").set_index("part")
    assert table.loc["test_unseen_clips", "frames"] == whole


def test_frames_of_an_unnamed_other_split_are_not_offered_to_be_scored(dataset, tmp_path):
    facts = {"held_out": {"val": [], "test": ["downtown/clip00"]}}
    predictions = write_predictions(dataset, tmp_path / "mine", facts=facts)
    (predictions / "predictions.json").write_text("{}")
    with pytest.raises(UserError, match=r"missing: .* extra: .* of another split, whose") as caught:
        scored(dataset, predictions)
    assert "allow_missing" not in str(caught.value)


@pytest.mark.parametrize("said", [[], {"val": []}, {"val": None, "test": None}, "towns"])
def test_a_split_that_is_none_is_named(dataset, tmp_path, said):
    predictions = write_predictions(dataset, tmp_path / "mine")
    (predictions / "predictions.json").write_text(json.dumps({"held_out": said}))
    with pytest.raises(UserError, match=r"predictions\.json: held_out: .* correct it, or leave it"):
        scored(dataset, predictions)


@pytest.mark.parametrize(("key", "value"), [("seed", None), ("parameters", "12M")])
def test_a_fact_that_is_no_number_is_named_before_anything_is_scored(dataset, tmp_path, key, value):
    facts = {"name": "mine", key: value}
    predictions = write_predictions(dataset, tmp_path / "mine", facts=facts)
    (predictions / "extra/occupancy.npz").parent.mkdir()
    (predictions / "extra/occupancy.npz").write_bytes(b"found only by who looks at the frames")
    with pytest.raises(UserError, match=rf"mine/predictions\.json: {key}: {value!r} is no whole"):
        scored(dataset, predictions)


@pytest.mark.parametrize("of_all", [True, False])
def test_calibration_is_of_all_frames_or_not_given(dataset, tmp_path, capsys, of_all):
    source = SkyShieldTruth(dataset, "test")
    predictions = write_predictions(dataset, tmp_path / "mine")
    for clip in dict(source.samples) if of_all else list(dict(source.samples))[:1]:
        frames = [frame for each, frame in source.samples if each == clip]
        scores = {f"logits_{n:06d}": np.zeros((9, *source.grid.shape), np.float16) for n in frames}
        np.savez_compressed(predictions / clip / "logits.npz", **scores)
    table = pd.read_csv(scored(dataset, predictions) / "scores.csv")
    assert ("ece" in set(table["score"])) == of_all
    assert ("frames, so no calibration" in capsys.readouterr().out) != of_all


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


def every_other_slice(labels):
    return torch.where(torch.arange(len(labels))[:, None, None] % 2 > 0, labels, FREE).byte()


def test_two_runs_are_compared_by_the_same_draws(dataset, runs, tmp_path):
    half = str(scored(dataset, write_predictions(dataset, tmp_path / "half", every_other_slice)))
    compare(config_for(dataset, "none"), [runs[0], half], str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out" / "differences.csv").set_index(["run", "score"])
    row = table.loc[("half", "kar_miou")]
    assert row["minus blind"] == pytest.approx(
        row["value"] - table.loc["blind", "value"]["kar_miou"]
    )
    blind, other = (Counts.read(next(Path(run).glob("tallies/*.npz"))) for run in (runs[0], half))
    settings = blind.protocol.suite
    generator = torch.Generator().manual_seed(settings["seed"])
    changes = []
    for clips in torch.randint(2, (settings["resamples"], 2), generator=generator).tolist():
        found = []
        for tally in (other, blind):
            tables = {k: v[clips].sum(0) for k, v in tally.tables["occupancy"].items()}
            found.append(float(tally.suite().metric("occupancy").scores(tables)["kar_miou"]))
        changes.append(found[0] - found[1])
    bounds = torch.tensor(changes, dtype=torch.float64).quantile(
        torch.tensor([0.025, 0.975]).double()
    )
    assert row[["difference_low", "difference_high"]].tolist() == pytest.approx(bounds.tolist())


def test_the_better_run_ranks_first_whatever_the_parameters(dataset, runs, tmp_path):
    compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))
    ranks = pd.read_csv(tmp_path / "out" / "sensitivity.csv")
    assert len(ranks) == 81
    assert (ranks["rank perfect"] == 1).all()
    assert (tmp_path / "out" / "sensitivity.png").stat().st_size > 10_000


def without_sensitivity(path):
    tally = Counts.read(path)
    del tally.tables["sensitivity"]
    tally.write(path)


def test_published_counts_are_compared_without_a_ranking(dataset, runs, tmp_path, capsys):
    cfg, out = config_for(dataset, "none"), tmp_path / "out"
    compare(cfg, runs, str(out))
    whole = (out / "differences.csv").read_bytes()
    without_sensitivity(next(Path(runs[1]).glob("tallies/*.npz")))
    capsys.readouterr()
    compare(cfg, runs, str(out))
    assert "no ranking under other parameters: perfect has no counts" in capsys.readouterr().out
    assert [path.name for path in out.iterdir()] == ["differences.csv"], "nothing of another time"
    assert (out / "differences.csv").read_bytes() == whole


def test_other_protocols_are_not_compared(dataset, runs, tmp_path):
    other = write_predictions(dataset, tmp_path / "other")
    folder = scored(dataset, other, "metric.horizon_s=4.0")
    with pytest.raises(UserError, match=r"^other: was scored with metric.horizon_s=4.0, and blind"):
        compare(config_for(dataset, "none"), [runs[0], str(folder)], str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_other_frames_of_the_same_clips_are_not_compared(dataset, runs, tmp_path):
    (path,) = Path(runs[1]).glob("tallies/perfect.npz")
    tally = Counts.read(path)
    first, second = tally.frames
    dataclasses.replace(tally, frames=[first - 1, second + 1]).write(path)
    with pytest.raises(
        UserError, match=r"^perfect: was scored on other clips or frames than blind"
    ):
        compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))


def test_other_labels_of_the_same_frames_are_not_compared(dataset, runs, tmp_path):
    (path,) = Path(runs[1]).glob("tallies/perfect.npz")
    tally = Counts.read(path)
    tally.tables["occupancy"]["count"][0] = tally.tables["occupancy"]["count"][0].roll(1, 0)
    tally.write(path)
    with pytest.raises(UserError, match=r"^perfect: was scored on other labels than blind; score"):
        compare(config_for(dataset, "none"), runs, str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_files_of_one_name_in_one_folder_are_all_compared(dataset, runs, tmp_path):
    (path,) = Path(runs[0]).glob("tallies/*.npz")
    for name in ("a", "b"):
        shutil.copy(path, tmp_path / f"{name}.npz")
    words = [str(tmp_path / "a.npz"), str(tmp_path / "b.npz"), runs[0]]
    compare(config_for(dataset, "none"), words, str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out" / "differences.csv")
    assert list(table["run"].unique()) == [f"blind {word}" for word in words]
    compare(config_for(dataset, "none"), words[:2], str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out" / "differences.csv")
    assert list(table["run"].unique()) == ["blind a.npz", "blind b.npz"]


def test_one_run_is_not_compared_with_itself(dataset, runs, tmp_path):
    (path,) = Path(runs[0]).glob("tallies/*.npz")
    with pytest.raises(UserError, match=r"^task.runs: .*blind.npz is named twice"):
        compare(config_for(dataset, "none"), [runs[0], str(path)], str(tmp_path / "out"))


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
    tallies = [Counts.read(next(Path(run).glob("tallies/*.npz"))) for run in runs]
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


def test_what_rounding_alone_tells_apart_shares_a_rank(dataset, tmp_path):
    half = write_predictions(dataset, tmp_path / "half", every_other_slice)
    first = scored(dataset, half) / "tallies" / "half.npz"
    tally = Counts.read(first)
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
