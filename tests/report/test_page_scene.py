"""What the page holds of a frame: the very labels, the image, the camera, and no more bytes than
that takes."""

import io
import json

import numpy as np
import pytest
from PIL import Image

from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import CAR, CLASSES, UNKNOWN
from src.report.scene import TRUTH, Scene, pack_labels, unpack_labels
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
    return Scene(**{**scene, **changes})


def test_labels_round_trip_whatever_their_layout():
    labels = np.random.default_rng(0).integers(0, len(CLASSES), (5, 4, 3), dtype=np.uint8)
    labels[0, 0, 0] = UNKNOWN
    for view in (labels, np.asfortranarray(labels), labels[::-1], labels.transpose(2, 0, 1)):
        assert (unpack_labels(pack_labels(view), view.shape) == view).all()


def test_z_is_the_fastest_index():
    labels = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4)
    flat = unpack_labels(pack_labels(labels), (24,))
    assert flat[(1 * 3 + 2) * 4 + 3] == labels[1, 2, 3]


def test_a_scene_says_where_its_voxels_are_and_what_they_are():
    scene = scene_of(SMALL)
    encoded = json.loads(json.dumps(scene.encoded()))
    assert (encoded["lower"], encoded["voxel"]) == ([0, -25, -20], 2)
    assert encoded["shape"] == [25, 25, 15]
    assert [volume["name"] for volume in encoded["volumes"]] == [TRUTH, "baseline", "skyocc"]
    for volume, (_, labels) in zip(encoded["volumes"], scene.volumes()):
        assert (unpack_labels(volume["labels"], SMALL.shape) == labels).all()
    lens, *corners = np.array(encoded["frustum"])
    assert np.allclose(corners, scene.frustum.corners(0.16 * 50), atol=1e-4)
    assert np.allclose(lens, scene.frustum.corners(0.0)[0], atol=1e-4)


def test_a_scene_without_a_camera_has_no_frustum():
    assert scene_of(SMALL, frustum=None).encoded()["frustum"] is None


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
    scene = scene_of(SMALL, predictions={"clean": clean, "junk": junk})
    stills = {still.caption: still for still in scene.stills()}
    assert list(stills) == [TRUTH, "clean", "junk"]
    assert {still.size_pix for still in stills.values()} == {(80, 60)}
    assert stills["clean"].encoded == stills["junk"].encoded != stills[TRUTH].encoded


def test_a_large_photo_is_made_smaller_and_keeps_its_shape():
    photo = scene_of(SMALL, image=np.zeros((448, 800, 3), np.uint8)).photo
    assert photo.size_pix == (640, 358)
    with Image.open(io.BytesIO(photo.encoded)) as image:
        assert image.format == "JPEG"


def test_a_scene_of_three_volumes_is_well_below_200_kilobytes():
    scene = scene_of(GRID)
    viewer_bytes = len(json.dumps(scene.encoded()))
    stills_bytes = sum(len(still.address) for still in scene.stills())
    assert viewer_bytes < 40_000
    assert viewer_bytes + stills_bytes + len(scene.photo.address) < 200_000
