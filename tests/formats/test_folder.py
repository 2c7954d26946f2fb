"""Folders in Occ3D's format: classes, grid and masks as stated, refused where they do not fit."""

import numpy as np
import pytest

from src.errors import UserError
from src.formats import LABEL_FORMATS
from src.formats.folder import LabelFolder
from src.geometry import VoxelGrid
from src.ontology import CAR, FREE, GROUND, UNKNOWN

GRID = VoxelGrid((-2, -2, -1), (2, 2, 1), (4, 4, 2))
CLASS_MAP = ["ground", "car", "unknown", "free"]
FRAME = ("scene-0001", "abc")


def occ3d_folder(root, class_map, grid):
    return LabelFolder(LABEL_FORMATS["occ3d"], root, class_map, grid)


def write(root, scene="scene-0001", token="abc", **arrays):
    path = root / scene / token / "labels.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **arrays)
    return path


@pytest.fixture
def semantics():
    return np.arange(32).reshape(4, 4, 2).astype(np.uint8) % 4


@pytest.fixture
def folder(tmp_path, semantics):
    write(tmp_path, semantics=semantics, mask_camera=semantics == 1, mask_lidar=semantics)
    return occ3d_folder(tmp_path, CLASS_MAP, GRID)


def test_their_classes_become_ours_and_masks_are_read_by_name(folder, semantics):
    assert folder.samples == [FRAME]
    expected = np.array([GROUND, CAR, UNKNOWN, FREE])[semantics]
    assert (folder.labels(*FRAME).numpy() == expected).all()
    assert (folder.mask(*FRAME, "mask_camera").numpy() == (semantics == 1)).all()
    assert (folder.mask(*FRAME, "mask_lidar").numpy() == (semantics > 0)).all()


def test_a_frame_that_the_map_or_the_grid_does_not_fit_is_refused(tmp_path, folder, semantics):
    for labels, message in (
        (semantics + 1, r"labels\.npz: class 4\b.*layout\.class_map"),
        (semantics[:3], r"labels\.npz: .*\[3, 4, 2\].*\[4, 4, 2\].*layout\.grid"),
    ):
        write(tmp_path, semantics=labels)
        with pytest.raises(UserError, match=message):
            folder.labels(*FRAME)


def test_files_right_in_the_folder_are_none_of_a_scene(tmp_path, semantics):
    np.savez_compressed(tmp_path / "labels.npz", semantics=semantics)
    with pytest.raises(UserError, match="holds no <scene>/<token>"):
        occ3d_folder(tmp_path, CLASS_MAP, GRID)


@pytest.mark.parametrize("number", [-1, "car"])
def test_what_is_no_id_is_refused(tmp_path, number):
    with pytest.raises(UserError, match=rf"layout\.class_map: {number!r} is no id"):
        occ3d_folder(tmp_path, {number: "unknown", 0: "free"}, GRID)


def test_a_name_that_is_no_class_and_a_folder_without_frames_are_refused(tmp_path):
    with pytest.raises(UserError, match=r"^layout\.class_map: 'kar'"):
        occ3d_folder(tmp_path, ["kar"], GRID)
    with pytest.raises(UserError, match=r"<scene>/<token>/labels\.npz"):
        occ3d_folder(tmp_path, CLASS_MAP, GRID)


def test_missing_extra_and_corrupt_frames_are_named(tmp_path, semantics):
    full = np.where(semantics == 2, 3, semantics)
    write(tmp_path, token="sound", semantics=full)
    write(tmp_path, token="extra", semantics=full)
    write(tmp_path, token="unknown", semantics=semantics)
    write(tmp_path, token="cut", semantics=full).write_bytes(b"PK")
    wanted = [("scene-0001", token) for token in ("sound", "missing", "unknown", "cut")]
    inventory = occ3d_folder(tmp_path, CLASS_MAP, GRID).inventory(wanted)
    assert inventory.missing == ["scene-0001/missing"]
    assert inventory.extra == ["scene-0001/extra"]
    cut, unknown = inventory.corrupt
    assert cut.startswith(f"{tmp_path}/scene-0001/cut/labels.npz: semantics cannot be read")
    assert unknown.startswith(f"{tmp_path}/scene-0001/unknown/labels.npz: ")
