"""Writing MCAP: whole files or none, and rotations that Euler angles cannot tell."""

import sys

import numpy as np
import pytest

from src.errors import UserError
from src.formats.mcap import McapWriter, quat_from_rotation
from src.geometry import VoxelGrid, front_mount, pinhole, rotation_from_quat

GRID = VoxelGrid((0, -2, -1), (4, 2, 1), (4, 4, 2))
CAMERA = front_mount((0.1, 0.0, 0.0)), pinhole(64, 32, 1.5), (64, 32)
LABELS = np.zeros(GRID.shape, np.uint8)


def test_a_quaternion_is_found_of_every_rotation():
    rng = np.random.default_rng(0)
    upright = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
    nose_down = [[0, 0.5**0.5, 0, 0.5**0.5], [0.5, 0.5, 0.5, 0.5], [-0.5, 0.5, 0.5, 0.5]]
    for quat in (*upright, *nose_down, *rng.normal(size=(100, 4))):
        rotation = rotation_from_quat(np.array(quat))
        found = quat_from_rotation(rotation)
        assert np.abs(rotation_from_quat(found) - rotation).max() < 1e-12
        assert abs(np.linalg.norm(found) - 1) < 1e-12


def test_an_error_leaves_the_old_file_and_no_other(tmp_path):
    pytest.importorskip("foxglove")
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"old")
    with McapWriter(path, GRID, *CAMERA) as file:
        file.add(0.0, np.eye(4), {"truth": LABELS})
        assert path.read_bytes() == b"old"
    whole = path.read_bytes()
    assert whole.startswith(b"\x89MCAP")
    with (
        pytest.raises(UserError, match=r"flight\.mcap: truth is \[3, 4, 2\], and the grid is \[4"),
        McapWriter(path, GRID, *CAMERA) as file,
    ):
        file.add(0.0, np.eye(4), {"truth": LABELS[1:]})
    assert [each.name for each in tmp_path.iterdir()] == ["flight.mcap"]
    assert path.read_bytes() == whole


def test_two_files_at_once_are_not_mixed(tmp_path):
    pytest.importorskip("foxglove")
    one, other = (tmp_path / name for name in ("one.mcap", "other.mcap"))
    with McapWriter(one, GRID, *CAMERA) as first, McapWriter(other, GRID, *CAMERA) as second:
        first.add(0.0, np.eye(4), {"truth": LABELS})
        second.add(0.0, np.eye(4), {"belief": LABELS})
    assert b"/belief" not in one.read_bytes()
    assert b"/truth" not in other.read_bytes()


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    pytest.importorskip("foxglove")
    writer = McapWriter(tmp_path / "flight.mcap", GRID, *CAMERA)
    opened = writer._sdk.open_mcap
    monkeypatch.setattr(writer._sdk, "open_mcap", lambda _, **more: opened("/dev/full", **more))
    noise = np.random.default_rng(0).integers(0, 256, (600, 800, 3)).astype(np.uint8)

    def write():
        with writer as file:
            for second in range(20):
                file.add(float(second), np.eye(4), {}, noise)

    with pytest.raises(UserError, match=r"flight\.mcap: cannot be written .*; free some space"):
        write()
    assert not [*tmp_path.iterdir()]


def test_without_the_library_its_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(
        UserError, match=r"flight\.mcap: needs foxglove; pip install -e '\.\[view\]'"
    ):
        McapWriter(tmp_path / "flight.mcap", GRID, *CAMERA)
