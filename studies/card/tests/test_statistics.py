"""The statistics against slow counts of the same files, and their definitions on made-up tables."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.clip import Clip
from src.data.manifest import MANIFEST, read_manifest, sealed
from src.errors import UserError
from src.geometry import VoxelGrid, camera_from_occ, in_image, project
from src.ontology import ACTOR_TYPES, CLASSES, UNKNOWN
from studies.card.statistics import (
    DENOMINATORS,
    Statistics,
    statistics_of,
    statistics_of_clips,
    voxels_in_image,
)
from tests.synthetic import write_clip


@pytest.fixture
def copy(mini_dataset, tmp_path):
    """The root of a copy that may be damaged."""
    return shutil.copytree(mini_dataset, tmp_path / "data")


def centers_in_image(clip, frame):
    """The projection chain itself, point by point."""
    meta = clip.meta
    centers = meta.grid.centers(torch.float64).flatten(0, 2)
    chain = camera_from_occ(clip.world_from_body[frame], meta.body_from_camera)
    pix, depth_m = project(centers, chain, meta.pix_from_camera)
    return int(in_image(pix, depth_m, meta.width, meta.height).sum())


def test_voxels_are_counted_by_class_and_by_denominator(mini_dataset, statistics):
    for clip_id, rows in statistics.frames.groupby("clip"):
        clip, row = Clip(mini_dataset / clip_id), rows.iloc[7]
        labels = clip.semantics(7)
        for class_id, name in enumerate(CLASSES):
            assert row[f"voxels/{name}"] == (labels == class_id).sum()
        assert row["voxels/labelled"] == (labels != UNKNOWN).sum()
        assert row["voxels/in image"] == centers_in_image(clip, 7)
        assert row["voxels/all"] == labels.size


# Its nearest voxels are nearer to the lens than what counts as in the image.
NEAR = VoxelGrid(lower_m=(0, -1.35, -1.4), upper_m=(2.7, 1.35, 1.3), shape=(9, 9, 9))


@pytest.mark.parametrize("grid", [VoxelGrid(shape=(50, 50, 30)), NEAR])
def test_voxels_in_the_image_are_those_of_the_projection_chain(tmp_path, grid):
    write_clip(tmp_path / "town/clip00", grid=grid)
    clip = Clip(tmp_path / "town/clip00")
    counted = voxels_in_image(clip)
    assert counted.tolist() == [centers_in_image(clip, frame) for frame in range(len(clip))]
    assert len(set(counted.tolist())) > 5


def test_motion_and_parts_are_those_of_the_frames(mini_dataset, statistics):
    frames = statistics.frames.set_index("clip")
    assert frames["part"].tolist() == [*["train"] * 25, *["val"] * 3, *["test"] * 32]
    assert statistics.part_sizes() == read_manifest(mini_dataset)["split"]
    assert statistics.clips["role"].tolist() == ["split", "test"]

    table = Clip(mini_dataset / "suburb/clip01").frames
    speed_mps = np.linalg.norm(table[["vx_mps", "vy_mps", "vz_mps"]], axis=1)
    for name, values in {**table, "speed_mps": speed_mps}.items():
        if name in frames:
            np.testing.assert_allclose(frames.loc["suburb/clip01", name], values)
    for row in statistics.clips.itertuples():
        files = (mini_dataset / row.clip).iterdir()
        assert row.bytes == sum(len(file.read_bytes()) for file in files)


def write_actors(folder, visible):
    """Replaces the actors of a synthetic clip by (frame, type, visible pixels)."""
    table = pd.DataFrame(visible, columns=["frame", "type", "visible_pixels"])
    header = (folder / "actors.csv").read_text().strip().split(",")
    table = table.assign(class_id=table["type"].map(ACTOR_TYPES)).reindex(columns=header)
    table.fillna(0.0).to_csv(folder / "actors.csv", index=False)


@pytest.mark.parametrize(("width", "height", "least"), [(160, 125, 1), (224, 128, 2)])
def test_an_actor_is_visible_from_a_share_of_the_image_on(tmp_path, width, height, least):
    """0.005 % of 20,000 pixels is one pixel, and of 28,672 more than one."""
    folder = tmp_path / "town/clip00"
    write_clip(folder, width=width, height=height)
    actors = [(0, "car", pixels) for pixels in (0, 1, 2, 500)] + [(3, "bus", 9), (3, "bus", 8)]
    write_actors(folder, actors)
    frames = statistics_of_clips(tmp_path, ["town/clip00"]).frames
    assert frames["visible/car"].tolist() == [4 - least] + [0] * 29
    assert frames["visible/bus"].tolist() == [0, 0, 0, 2] + [0] * 26
    assert not frames[["visible/truck", "visible/pedestrian"]].any(axis=None)


def made_up(voxels, altitude_m=(5.0,), **columns):
    """Statistics of frames with the given voxels by class; a third of the image is unlabelled."""
    rows = len(altitude_m)
    table = {f"voxels/{name}": [voxels.get(name, 0)] * rows for name in CLASSES}
    labelled = sum(voxels.values())
    for of, factor in zip(DENOMINATORS, (1, 1.5, 3)):
        table[f"voxels/{of}"] = [factor * labelled] * rows
    frames = pd.DataFrame({"altitude_m": altitude_m, **table, **columns})
    return Statistics(frames, frames.reindex(columns=["town", "weather"]))


def test_shares_have_three_denominators_and_rare_classes_are_set_against_vrus():
    shares = made_up({"free": 90, "thin_structure": 8, "car": 2}).class_shares()
    assert list(shares.index) == list(CLASSES)
    assert shares.loc["free"].tolist() == pytest.approx([0.9, 0.6, 0.3])
    assert shares.loc["car"].tolist() == pytest.approx([0.02, 0.02 / 1.5, 0.02 / 3])
    assert shares.loc["vru"].tolist() == [0, 0, 0]

    rare = {"thin_structure": 48, "car": 12, "vru": 3, "free": 1000}
    assert made_up(rare).thin_car_vru() == pytest.approx((16, 4, 1))
    assert np.isnan(made_up({"car": 5}).thin_car_vru()).all()


def test_a_frame_at_11_m_is_not_below_11_m():
    statistics = made_up({"free": 1}, altitude_m=(3.0, 10.9, 11.0, 12.0))
    assert (statistics.share_below(), statistics.share_below(3.5)) == (0.5, 0.25)


def test_the_matrix_keeps_the_order_of_the_clips_and_shows_what_is_not_there():
    towns, weathers = ["suburb", "park", "suburb"], ["rain", "clear", "clear"]
    altitude_m = (1.0, 2.0, 3.0)
    statistics = made_up({"free": 1}, altitude_m, town=towns, weather=weathers)
    matrix = statistics.by_town_and_weather(statistics.frames)
    assert matrix.index.tolist() == ["suburb", "park"]
    assert matrix.columns.tolist() == ["rain", "clear"]
    assert matrix.to_numpy().tolist() == [[1, 1], [0, 1]]


def test_the_clip_table_adds_up(statistics):
    table = statistics.clip_table().set_index("clip")
    assert list(table.columns)[-1] == "bytes"
    for clip_id, rows in statistics.frames.groupby("clip"):
        row = table.loc[clip_id]
        assert row["frames"] == 30
        assert row["mean_altitude_m"] == pytest.approx(rows["altitude_m"].mean(), abs=1e-4)
        assert row["visible_car"] == rows["visible/car"].sum()
        assert row[[f"share_{name}" for name in CLASSES]].sum() == pytest.approx(1, abs=1e-6)


def test_clips_come_in_the_order_of_the_towns_of_the_plan(copy):
    shutil.copytree(copy / "suburb/clip00", copy / "downtown/clip00")
    manifest = read_manifest(copy)
    manifest["sim"]["towns"].append("downtown")
    manifest["clips"]["downtown/clip00"] = manifest["clips"].pop("suburb/clip00")
    (copy / MANIFEST).write_text(json.dumps(sealed(manifest), sort_keys=True))
    assert list(read_manifest(copy)["clips"]) == ["downtown/clip00", "suburb/clip01"]
    assert statistics_of(copy).clips["clip"].tolist() == ["suburb/clip01", "downtown/clip00"]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda root: shutil.rmtree(root / "suburb/clip01"), r"1 of 2 clips.*suburb/clip01 first"),
        (lambda root: (root / "suburb/clip01/occupancy.npz").write_bytes(b"PK"), "occupancy.npz"),
    ],
)
def test_what_cannot_be_read_is_named_in_one_line(copy, damage, message):
    damage(copy)
    with pytest.raises(UserError, match=message) as error:
        statistics_of(copy)
    assert "task=generate" in str(error.value)
    assert "\n" not in str(error.value)
