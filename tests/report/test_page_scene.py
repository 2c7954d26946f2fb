"""What the page holds of a frame: labels, meshes, the image, the camera, and few bytes."""

import io
import json

import numpy as np
import plotly.graph_objects as go
import pytest
import torch
from PIL import Image

from src.errors import UserError
from src.geometry import VoxelGrid, project
from src.ontology import CAR, FREE, UNKNOWN
from src.report.scene import ERROR_PALETTE, TRUTH, VoxelScene, errors_of
from tests.report.sample_page import labels_in, read_scene
from tests.report.street import GRID, HEIGHT, WIDTH, street, tilted_frustum

SMALL = VoxelGrid(shape=(25, 25, 15))


def scene_of(grid, **changes):
    """A street, its labels seen by a tilted camera, and two predictions that err differently."""
    frustum = tilted_frustum(0.2, 0.1)
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    shifted = np.roll(street(grid), 2, axis=1)
    noisy = street(grid)
    noisy[np.random.default_rng(1).random(grid.shape) < 0.01] = CAR
    scene = {
        "title": "downtown-03 frame 41",
        "grid": grid,
        "image": image,
        "truth": street(grid, frustum),
        "predictions": {"baseline": shifted, "skyocc": noisy},
        "frustum": frustum,
    }
    return VoxelScene(**{**scene, **changes})


def faces_in(meshes):
    return {mesh["name"]: len(mesh["meta"]) for mesh in meshes}


def test_a_scene_says_where_its_voxels_are_and_what_they_are():
    scene = scene_of(SMALL)
    encoded = read_scene(scene.packed())
    assert (encoded["lower"], encoded["voxel"], encoded["shape"]) == (
        [0, -25, -20],
        2,
        [25, 25, 15],
    )
    assert encoded["names"][CAR] == "car"
    assert encoded["names"][FREE:] == ["free", "unknown"]
    assert [view["name"] for view in encoded["views"]] == [TRUTH, "baseline", "skyocc"]
    for view, labels in zip(encoded["views"], scene.volumes.values()):
        assert (labels_in(view, SMALL.shape) == labels).all()


def test_plotly_takes_every_view_and_all_have_the_same_ranges():
    predictions = {"shifted": scene_of(SMALL).predictions["baseline"]}
    encoded = scene_of(SMALL, predictions=predictions).encoded()
    for view in encoded["views"]:
        for meshes in view["meshes"].values():
            figure = go.Figure([*meshes, *encoded["lines"]], encoded["layout"])
            assert len(figure.data) == len(meshes) + 2
    scene = encoded["layout"]["scene"]
    assert [scene[f"{axis}axis"]["range"] for axis in "xyz"] == [(0, 50), (-25, 25), (-12, 8)]
    assert scene["aspectratio"] == pytest.approx({"x": 1.5, "y": 1.5, "z": 1.5 * 20 / 50})


def test_predictions_show_the_space_of_the_labels_and_on_demand_all():
    scene = scene_of(SMALL)
    junk = np.where(scene.truth == UNKNOWN, np.uint8(CAR), scene.truth)
    truth, view = scene_of(SMALL, predictions={"junk": junk}).encoded()["views"]
    assert faces_in(view["meshes"]["classes"]) == faces_in(truth["meshes"]["classes"])
    assert (
        faces_in(view["meshes"]["everywhere"])["car"] > faces_in(truth["meshes"]["classes"])["car"]
    )
    assert list(faces_in(view["meshes"]["errors"])) == ["right"]


def test_errors_are_told_apart_and_counted():
    truth = np.array([CAR, CAR, CAR, FREE, FREE, UNKNOWN, UNKNOWN], np.uint8)
    preds = np.array([CAR, 0, FREE, CAR, FREE, CAR, FREE], np.uint8)
    assert errors_of(truth, preds).tolist() == [0, 1, 3, 2, *[UNKNOWN] * 3]
    assert list(ERROR_PALETTE) == ["right", "other class", "false alarm", "missed"]
    views = scene_of(SMALL).encoded()["views"]
    errors = errors_of(scene_of(SMALL).truth, scene_of(SMALL).predictions["skyocc"])
    expected = [f"{name} {(errors == n).sum():,}" for n, name in enumerate(ERROR_PALETTE)]
    assert views[2]["counts"].split(" · ") == expected
    assert views[0]["counts"] == ""


def test_points_project_into_the_image_as_the_camera_sees_them():
    scene = scene_of(SMALL)
    matrix = np.array(scene.encoded()["share_from_occ"])
    points = SMALL.centers(torch.float64).reshape(-1, 3)[::97]
    frustum = scene.frustum
    pix, depth = project(points, frustum.camera_from_occ, frustum.pix_from_camera)
    projected = np.hstack([points, np.ones((len(points), 1))]) @ matrix.T
    before = (depth > 1).numpy()
    shares = projected[before, :2] / projected[before, 2:]
    assert before.sum() > 20
    assert np.allclose(projected[:, 2], depth)
    assert np.allclose(shares * (WIDTH, HEIGHT), pix[before])


def test_the_lines_are_the_plumb_line_and_if_there_is_a_camera_the_frustum():
    scene = scene_of(SMALL)
    encoded = scene.encoded()
    plumb, frustum = encoded["lines"]
    assert plumb["z"] == (encoded["layout"]["scene"]["zaxis"]["range"][0], 0)
    drawn = np.unique(np.stack([frustum[axis] for axis in "xyz"], axis=-1).round(6), axis=0)
    corners = torch.cat([scene.frustum.corners(0.0)[:1], scene.frustum.corners(0.16 * 50)])
    assert np.allclose(drawn, np.unique(corners.numpy().round(6), axis=0))

    empty = np.full(SMALL.shape, FREE, np.uint8)
    encoded = scene_of(SMALL, truth=empty, predictions={}, frustum=None).encoded()
    assert encoded["lines"] == [{**plumb, "z": (0, 0)}]
    assert encoded["views"][0]["meshes"] == {"classes": []}
    assert not np.any(encoded["share_from_occ"])


@pytest.mark.parametrize("name", ["baseline", TRUTH])
def test_labels_of_another_grid_and_a_name_that_is_taken_are_refused(name):
    labels = street(GRID if name == "baseline" else SMALL)
    with pytest.raises(UserError, match=r"grid\.shape|rename"):
        scene_of(SMALL, predictions={name: labels})


def test_the_stills_are_of_one_size_and_hide_what_nobody_knows(monkeypatch):
    monkeypatch.setattr("src.report.scene.STILL_PIX", (80, 60))
    scene = scene_of(SMALL)
    clean = scene.predictions["skyocc"]
    junk = np.where(scene.truth == UNKNOWN, np.uint8(CAR), clean)
    image = np.zeros((448, 800, 3), np.uint8)
    scene = scene_of(SMALL, predictions={"clean": clean, "junk": junk}, image=image)
    stills = {still.caption: still.encoded for still in scene.stills()}
    sizes = {name: Image.open(io.BytesIO(encoded)).size for name, encoded in stills.items()}
    assert sizes == {"RGB": (640, 358), TRUTH: (80, 60), "clean": (80, 60), "junk": (80, 60)}
    assert stills["clean"] == stills["junk"] != stills[TRUTH]


def test_a_scene_of_three_volumes_is_well_below_three_megabytes():
    scene = scene_of(GRID)
    assert len(scene.packed()) < 1_500_000
    assert len(json.dumps(scene.encoded())) < 6_000_000, "a phone unpacks it too"
    assert sum(len(still.address) for still in scene.stills()) < 200_000
