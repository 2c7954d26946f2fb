"""task=score and task=compare as their user meets them."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.predictions import FACTS, PredictedFrame, save_predictions
from src.data.truth import SkyShieldTruth
from src.errors import UserError
from src.ontology import BUILDING, CLASSES, FREE, UNKNOWN
from src.results.bootstrap import interval_of
from src.results.counts import Counts
from src.results.files import read_results
from src.results.table import Resamples
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

    def frames():
        for clip, frame in source.samples:
            labels = source.truth(clip, frame)["semantics"][0]
            labels = torch.where(labels == UNKNOWN, FREE, labels).byte()
            yield PredictedFrame(clip, frame, change(labels))

    save_predictions(folder, facts or {"name": folder.name}, frames())
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


def test_what_is_lost_is_seen_by_every_table_and_every_class_has_a_row(dataset, tmp_path):
    folder = scored(dataset, write_predictions(dataset, tmp_path / "blind", without_buildings))
    row = read_results(folder / "results.csv").iloc[0]
    assert row["iou/building"] == 0
    assert row["kar_miou"] < row["miou"] < 1
    parts = pd.read_csv(folder / "breakdown.csv").set_index(["scope", "part", "class"])
    assert parts.loc[("all", "whole", "building"), "kar_iou"] == 0
    assert parts.loc[("all", "whole", "ground"), "iou"] == 1
    for _, of_part in parts.groupby(["scope", "part"]):
        assert set(of_part.index.get_level_values("class")) == set(CLASSES)
        assert len(of_part) == len(CLASSES)


def test_another_part_and_the_visible_voxels_have_their_own_protocol(dataset, tmp_path):
    predictions = write_predictions(dataset, tmp_path / "val", part="val")
    folder = scored(dataset, predictions, "layout.mask=visible", part="val")
    (row,) = read_results(folder / "results.csv").to_dict("records")
    assert row["split"] == "val"
    protocol = json.loads((folder / f"protocol-{row['protocol']}.json").read_text())
    assert (protocol["mask"], protocol["part"]) == ("visible voxels", "val")


def drop_a_frame(path):
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files[1:]}
    np.savez_compressed(path, **arrays)


def cut(path):
    path.write_bytes(path.read_bytes()[:-50])


@pytest.mark.parametrize(("damage", "word"), [(drop_a_frame, "missing"), (cut, "corrupt")])
def test_a_damaged_folder_is_scored_only_when_told_so(dataset, tmp_path, damage, word):
    predictions = write_predictions(dataset, tmp_path / "mine")
    damage(next(predictions.rglob("occupancy.npz")))
    with pytest.raises(UserError, match=f"1 {word}: .*task.allow_missing=true") as error:
        scored(dataset, predictions)
    assert str(error.value).startswith(str(predictions))
    assert not (predictions / "scores").exists()
    folder = scored(dataset, predictions, allow_missing=True)
    counts = Counts.read(folder / "tallies/mine.npz")
    assert counts.protocol.frames == sum(counts.frames) < len(SkyShieldTruth(dataset).samples)


def rewrite(change):
    """A damage: every array of the file after a change."""

    def damage(path):
        with np.load(path) as archive:
            arrays = {name: change(archive[name]) for name in archive.files}
        np.savez(path, **arrays)

    return damage


def as_one_array(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def without_names(path):
    with np.load(path) as archive:
        arrays = [archive[name] for name in archive.files]
    np.savez(path, *arrays)


FOREIGN = {
    "no name": (without_names, "missing.*arr_0"),
    "z, y, x": (rewrite(np.transpose), r"is \[\d+, \d+, \d+\], and the grid is"),
    "more classes": (rewrite(lambda labels: labels + 15), "has classes 1[56] to 23"),
    "NaN": (rewrite(lambda labels: np.full(labels.shape, np.nan, np.float32)), "no whole numbers"),
    "a pointer": (
        lambda path: path.write_text("version https://git-lfs.github.com"),
        "git lfs pull",
    ),
    "a pointer of git-annex": (
        lambda path: path.write_text("/annex/objects/SHA256E-s1--0.npz\n"),
        "git annex get",
    ),
    "a web page": (lambda path: path.write_text("\n<!DOCTYPE html><html>"), "download it again"),
    "one array": (as_one_array, "numpy.savez"),
}


@pytest.mark.parametrize("case", FOREIGN)
def test_why_somebody_s_predictions_cannot_be_scored_is_said(dataset, tmp_path, case):
    damage, message = FOREIGN[case]
    predictions = write_predictions(dataset, tmp_path / "mine")
    path = next(predictions.rglob("occupancy.npz"))
    damage(path)
    with pytest.raises(UserError, match=message) as told:
        scored(dataset, predictions)
    assert case == "no name" or str(path) in str(told.value)


def test_big_endian_whole_floats_and_links_are_as_good(dataset, tmp_path):
    """Labels of any kind of number, in folders that lie elsewhere."""
    predictions = write_predictions(dataset, tmp_path / "mine")
    one, other = sorted(predictions.rglob("occupancy.npz"))
    rewrite(lambda labels: labels.astype(">i4"))(one)
    rewrite(lambda labels: labels.astype(np.float64))(other)
    town = one.parent.parent
    town.rename(tmp_path / "elsewhere")
    town.symlink_to(tmp_path / "elsewhere")
    assert (read_results(scored(dataset, predictions) / "results.csv")["miou"] == 1).all()


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


NO_SPLIT = r"predictions\.json: held_out: .* correct it, or leave it"


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"dataset": "paper-0123"}, "predictions of paper-0123, not of"),
        ({"held_out": {"val": []}}, NO_SPLIT),
        ({"held_out": {"val": None, "test": None}}, NO_SPLIT),
        ({"part": "val"}, r"mine/predictions\.json: of the part 'val'; give task\.part=val"),
        ({"seed": None}, r"mine/predictions\.json: seed: None is no whole"),
        ({"parameters": "12M"}, r"mine/predictions\.json: parameters: '12M' is no whole"),
    ],
)
def test_what_predictions_say_wrongly_is_named_before_any_is_read(dataset, tmp_path, said, message):
    predictions = write_predictions(dataset, tmp_path / "mine")
    (predictions / FACTS).write_text(json.dumps(said))
    (predictions / "extra").mkdir()
    (predictions / "extra/occupancy.npz").write_bytes(b"found only by who looks at the frames")
    with pytest.raises(UserError, match=message):
        scored(dataset, predictions)


def test_predictions_of_another_split_are_scored_by_it_where_they_say_so(dataset, tmp_path):
    facts = {"name": "mine", "held_out": {"val": [], "test": ["downtown/clip00"]}}
    assert SkyShieldTruth(dataset).unseen == {"suburb/clip00"}
    predictions = write_predictions(dataset, tmp_path / "mine", facts=facts)
    folder = scored(dataset, predictions)
    assert (read_results(folder / "results.csv")["miou"] == 1).all()
    frames = pd.read_csv(folder / "scores.csv").drop_duplicates("part").set_index("part")["frames"]
    assert frames["test_unseen_clips"] > frames["test_seen_clips"], "it has all of its frames"

    # Where they do not say it, they are not offered to be scored in part.
    (predictions / FACTS).write_text("{}")
    with pytest.raises(UserError, match=r"missing: .* extra: .* of another split, whose") as caught:
        scored(dataset, predictions)
    assert "allow_missing" not in str(caught.value)


def test_calibration_is_of_all_frames_or_not_given(dataset, tmp_path, capsys):
    source = SkyShieldTruth(dataset, "test")
    predictions = write_predictions(dataset, tmp_path / "mine")
    for clip, of_all in zip(dict(source.samples), (False, True), strict=True):
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
    (_, rows), *others = read_results(folder / "results.csv").iterrows()
    assert not others, "no part without a frame"
    assert rows["kar_miou"] == 1  # wrong only where the camera does not see
    assert "velocity_mps" in (folder / f"protocol-{rows['protocol']}.json").read_text()

    everywhere = scored(tmp_path / "gts", tmp_path / "mine", *words, "layout.mask=supervised")
    assert read_results(everywhere / "results.csv").iloc[0]["kar_miou"] < 0.9


# ------------------------------------------------------------------------------- runs are compared


def every_other_slice(labels):
    return torch.where(torch.arange(len(labels))[:, None, None] % 2 > 0, labels, FREE).byte()


def file_of(run):
    """The file of counts of a scored folder."""
    (path,) = run.glob("tallies/*.npz")
    return path


@pytest.fixture
def runs(dataset, tmp_path):
    changes = {"blind": without_buildings, "perfect": lambda labels: labels}
    predictions = [write_predictions(dataset, tmp_path / name, of) for name, of in changes.items()]
    return [scored(dataset, folder) for folder in predictions]


@pytest.fixture
def compared(dataset, tmp_path):
    """Compares runs in a folder, and returns the table of their differences."""

    def differences(runs, clips=(), out="out"):
        compare(config_for(dataset, "none"), list(map(str, runs)), str(tmp_path / out), clips)
        return pd.read_csv(tmp_path / out / "differences.csv")

    return differences


def test_two_runs_are_compared_by_the_same_draws(dataset, runs, compared, tmp_path):
    half = scored(dataset, write_predictions(dataset, tmp_path / "half", every_other_slice))
    table = compared([runs[0], half]).set_index(["run", "score"])
    row = table.loc[("half", "kar_miou")]
    blind, other = (Counts.read(file_of(run)) for run in (runs[0], half))
    drawn = Resamples({"blind": {0: blind}, "half": {0: other}})
    change = interval_of(drawn.change("half", "blind", "kar_miou"), drawn.level)
    columns = ["minus blind", "difference_low", "difference_high"]
    assert row[columns].tolist() == pytest.approx(list(change))
    assert row["recipe"] == "unknown", "its predictions do not name one"


def test_runs_of_two_recipes_are_compared_with_the_recipe_beside_them(
    dataset, compared, tmp_path, capsys
):
    places = [
        write_predictions(dataset, tmp_path / name, facts={"name": name, "recipe": name})
        for name in ("strong", "paper")
    ]
    both = [scored(dataset, place) for place in places]
    assert read_results(both[1] / "results.csv")["recipe"].unique().tolist() == ["paper"]
    table = compared(both)
    assert (table["recipe"] == table["run"]).all()
    assert "Recipe" in capsys.readouterr().out


def with_other_frames(counts):
    counts.frames[:] = counts.frames[0] - 1, counts.frames[1] + 1


def with_other_labels(counts):
    table = counts.tables["occupancy"]["count"]
    table[0] = table[0].roll(1, 0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (with_other_frames, "on other clips or frames than blind; score both alike"),
        (with_other_labels, "on other labels than blind; score both alike"),
        (None, "with metric.horizon_s=4.0, and blind"),
    ],
)
def test_other_frames_labels_or_protocols_are_not_compared(
    dataset, runs, compared, tmp_path, change, said
):
    if change:
        change(counts := Counts.read(file_of(runs[1])))
        counts.write(file_of(runs[1]))
    else:
        scored(dataset, tmp_path / "perfect", "metric.horizon_s=4.0")
    with pytest.raises(UserError, match=f"^perfect: was scored {said}"):
        compared(runs)
    assert not (tmp_path / "out").exists()


def test_runs_of_one_name_are_told_apart_by_their_files_and_folders(runs, compared, tmp_path):
    files = [shutil.copy(file_of(runs[0]), tmp_path / f"{name}.npz") for name in "ab"]
    three = [*files, runs[0]]
    assert list(compared(three)["run"].unique()) == [f"blind {place}" for place in three]
    assert list(compared(files)["run"].unique()) == ["blind a.npz", "blind b.npz"]

    seeds = [shutil.copytree(runs[0], tmp_path / f"seed{seed}/test") for seed in (0, 1)]
    assert set(compared(seeds)["run"]) == {"blind seed0", "blind seed1"}


def test_a_comparison_of_some_clips_is_of_these_alone(runs, compared, tmp_path, capsys):
    counts = [Counts.read(file_of(run)) for run in runs]
    clip = counts[0].clips[1]
    alone = [tmp_path / "a.npz", tmp_path / "b.npz"]
    for of_run, path in zip(counts, alone):
        of_run.of_clips(lambda each: each == clip).write(path)

    capsys.readouterr()
    some = compared(runs, [f"{clip[:-1]}?", clip])
    printed = " ".join(capsys.readouterr().out.split())
    assert "intervals (clips: 1)," in printed
    assert "nan" not in printed
    pd.testing.assert_frame_equal(some, compared(alone))
    assert not some["value"].equals(compared(runs, ["*"])["value"])


def test_a_comparison_needs_two_runs_and_clips_that_are_there(runs, compared, tmp_path):
    blind, table = runs[0], tmp_path / "results.csv"
    table.write_text("experiment,scale\n")
    for places, clips, message in (
        ([blind], [], "^task.runs: name two or more"),
        ([blind, file_of(blind)], [], "^task.runs: .*blind.npz is named twice"),
        ([*runs, tmp_path / "nowhere"], [], "^task.runs: .*nowhere is neither"),
        ([*runs, tmp_path], [], "holds 0 scored runs"),
        ([*runs, table], [], "^task.runs: .*results.csv holds no counts; name its folder"),
        (runs, ["*", "town/x"], "^task.clips: no scored clip is like 'town/x'; there are"),
    ):
        with pytest.raises(UserError, match=message):
            compared(places, clips)
        assert not (tmp_path / "out").exists()
