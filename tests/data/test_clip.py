"""One clip on disk: whole or not at all, the same bytes for the same input, and honest errors."""

import errno
import json
import os
import pickle
import resource
import zipfile
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
import torch

from src.data import clip as clip_module
from src.data.clip import (
    ACTOR_COLUMNS,
    FRAME_COLUMNS,
    SUMS,
    Clip,
    ClipWriter,
    damaged_files,
    poses_of,
    recorded_sums,
)
from src.data.files import OpenArchives, sha256_of
from src.errors import UserError
from src.geometry import VoxelGrid
from tests.synthetic import meta_of

FRAMES = 30
READ = ("clip.json", "frames.csv", "actors.csv", "rgb.zip", "occupancy.npz")
SHAPE = (5, 4, 3)
META = meta_of("suburb", 2.5, 64, 32, VoxelGrid((0, -2, -1), (5, 2, 2), SHAPE), seed=3)


def content(seed=0):
    """Everything that a writer is given."""
    rng = np.random.default_rng(seed)
    frames = pd.DataFrame(rng.standard_normal((FRAMES, len(FRAME_COLUMNS))), columns=FRAME_COLUMNS)
    frames["frame"], frames["time_s"] = np.arange(FRAMES), np.arange(FRAMES) / 2.5
    actors = pd.DataFrame(rng.standard_normal((4, len(ACTOR_COLUMNS))), columns=ACTOR_COLUMNS)
    actors["type"] = "car"

    return {
        "images": rng.integers(0, 256, (FRAMES, 32, 64, 3), dtype=np.uint8) // 8 + 100,
        "semantics": rng.choice(np.array([0, 5, 8, 255], np.uint8), (FRAMES, *SHAPE)),
        "visible": rng.random((FRAMES, *SHAPE)) < 0.5,
        "depth": rng.random((FRAMES, 32, 64), dtype=np.float32) * 50,
        "frames": frames,
        "actors": actors,
    }


def fill(writer, what, aux=True):
    for frame in range(FRAMES):
        writer.add_image(frame, what["images"][frame])
        writer.add_labels(frame, what["semantics"][frame], what["visible"][frame])
        if aux:
            writer.add_aux(frame, depth=what["depth"][frame])
    writer.add_tables(what["frames"], what["actors"])


def write(folder, what=None, aux=True):
    with ClipWriter(folder, META) as writer:
        fill(writer, what or content(), aux)
    return folder


@pytest.fixture
def folder(tmp_path):
    return write(tmp_path / "suburb/clip00")


# ------------------------------------------------------------------------------- round trip


def test_what_is_written_is_read(folder):
    what, clip = content(), Clip(folder)
    assert clip.clip_id == "suburb/clip00"
    assert clip.meta.to_json() == META.to_json()
    assert torch.equal(clip.meta.body_from_camera, META.body_from_camera)
    assert clip.meta.grid == META.grid
    pd.testing.assert_frame_equal(clip.frames, what["frames"], check_exact=True)
    pd.testing.assert_frame_equal(clip.actors, what["actors"], check_exact=True)
    assert torch.equal(clip.world_from_body, poses_of(what["frames"]))

    assert len(clip) == FRAMES
    for frame in (7, 0, 29):
        np.testing.assert_array_equal(clip.semantics(frame), what["semantics"][frame], strict=True)
        np.testing.assert_array_equal(clip.visible(frame), what["visible"][frame], strict=True)
        np.testing.assert_array_equal(clip.aux("depth", frame), what["depth"][frame])
        error = np.abs(clip.image(frame).astype(int) - what["images"][frame])
        assert error.mean() < 6


def test_plain_tools_read_it(folder, tmp_path):
    with zipfile.ZipFile(folder / "rgb.zip") as archive:
        assert archive.namelist()[:2] == ["000000.jpg", "000001.jpg"]
        kinds = {(member.compress_type, member.date_time) for member in archive.infolist()}
    assert kinds == {(zipfile.ZIP_STORED, (1980, 1, 1, 0, 0, 0))}
    with np.load(folder / "occupancy.npz", allow_pickle=False) as arrays:
        assert {"semantics_000000", "visible_000029"} <= set(arrays.files)
    keys = "town weather seed capture_hz image pix_from_camera body_from_camera grid"
    assert " ".join(json.loads((folder / "clip.json").read_text())) == keys
    assert {path.name for path in folder.iterdir()} == {*READ, "aux.npz", SUMS}
    without = write(tmp_path / "t/c", aux=False)
    assert {path.name for path in without.iterdir()} == {*READ, SUMS}


def test_identical_input_gives_identical_bytes_whatever_a_killed_writer_left(folder, tmp_path):
    part = tmp_path / "b/.clip00.part"
    part.mkdir(parents=True)
    (part / "old.bin").write_bytes(b"rubbish")
    again, other = write(tmp_path / "b/clip00"), write(tmp_path / "c/clip00", content(1))
    assert [path.name for path in again.parent.iterdir()] == ["clip00"]
    assert recorded_sums(again) == recorded_sums(folder)
    for name, digest in recorded_sums(other).items():
        assert digest == sha256_of(other / name)
        assert (digest != recorded_sums(folder)[name]) == (name != "clip.json")


# ------------------------------------------------------------------------ whole or not at all


def test_an_interrupted_clip_leaves_nothing(tmp_path):
    with suppress(KeyboardInterrupt), ClipWriter(tmp_path / "t/c", META) as writer:
        writer.add_image(0, content()["images"][0])
        raise KeyboardInterrupt
    assert not list((tmp_path / "t").iterdir())


def test_the_folder_appears_when_all_is_in_it_and_on_the_disk(tmp_path, monkeypatch):
    folder, events = tmp_path / "t/c", []
    rename, flush = clip_module.os.rename, clip_module.flush_to_disk
    monkeypatch.setattr(
        clip_module, "flush_to_disk", lambda path: (events.append(path.name), flush(path))
    )
    monkeypatch.setattr(
        clip_module.os, "rename", lambda *paths: (events.append("rename"), rename(*paths))
    )

    with ClipWriter(folder, META) as writer:
        fill(writer, content())
        assert not folder.exists()
    assert events[-1] == "rename"
    assert set(events[:-1]) == {".c.part", *(path.name for path in folder.iterdir())}
    assert damaged_files(folder) == []


class FullDisk:
    """A file on a disk that is full after some bytes."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, data):
        self.room -= len(data)
        if self.room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.file.write(data)

    def __getattr__(self, name):
        return getattr(self.file, name)


@pytest.mark.parametrize("room", [0, 20_000])
@pytest.mark.parametrize("name", ["rgb.zip", "occupancy.npz", "aux.npz"])
def test_a_full_disk_is_named_and_leaves_nothing(tmp_path, monkeypatch, name, room):
    real = zipfile.io.open

    def opened(path, *args, **kwargs):
        file = real(path, *args, **kwargs)
        return FullDisk(file, room) if str(path).endswith(name) else file

    what = content()
    what["semantics"] = np.random.default_rng(0).integers(0, 255, (FRAMES, 60, 60, 4), np.uint8)
    what["visible"] = what["semantics"] > 0
    monkeypatch.setattr(zipfile.io, "open", opened)
    with pytest.raises(OSError, match="No space left") as error:
        write(tmp_path / "t/c", what)
    assert error.value.errno == errno.ENOSPC
    assert str(error.value.filename).endswith(name)
    assert not list((tmp_path / "t").iterdir())


def test_a_disk_that_is_full_at_the_end_is_named_too(tmp_path, monkeypatch):
    def full(path, *args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(clip_module.Path, "write_text", full)
    with pytest.raises(OSError, match=r"frames\.csv"):
        write(tmp_path / "t/c")
    assert not list((tmp_path / "t").iterdir())


# ---------------------------------------------------------------------------- damaged files


def read_all(folder):
    clip = Clip(folder)
    clip.actors.to_numpy()
    for frame in range(FRAMES):
        clip.image(frame)
        clip.semantics(frame)
        clip.visible(frame)


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("keep", [None, 0.0, 0.3, 0.9])
def test_a_truncated_or_missing_file_is_named(folder, name, keep):
    path = folder / name
    if keep is None:
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    with pytest.raises(UserError, match=rf"^[^\n]*{path}[^\n]*task=generate[^\n]*$"):
        read_all(folder)
    assert damaged_files(folder) == [name]


@pytest.mark.parametrize("name", READ)
def test_whatever_bytes_are_wrong_no_other_error_escapes(folder, name):
    path = folder / name
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    messages = []
    for _ in range(40):
        broken = np.frombuffer(whole, np.uint8).copy()
        start = int(rng.integers(len(broken)))
        broken[start : start + 40] = rng.integers(0, 256, len(broken[start : start + 40]))
        path.write_bytes(broken.tobytes())
        assert damaged_files(folder) == [name]
        try:
            read_all(folder)
        except UserError as error:
            messages.append(str(error))
    assert all(name in message for message in messages)
    assert len(messages) > (20 if name.endswith(("zip", "npz")) else 5)


def test_an_archive_that_claims_to_be_encrypted_and_a_missing_frame_are_refused(folder):
    path = folder / "rgb.zip"
    with pytest.raises(UserError, match=r"rgb\.zip"):
        Clip(folder).image(FRAMES)
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(bytes(data))
    with pytest.raises(UserError, match=r"rgb\.zip"):
        Clip(folder).image(0)


def test_other_json_and_a_table_without_its_last_row_are_refused(folder):
    table, meta = folder / "frames.csv", folder / "clip.json"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(UserError, match=r"frames\.csv"):
        Clip(folder)
    for text in ("[]", "null", '{"town": 3}'):
        meta.write_text(text)
        with pytest.raises(UserError, match=r"clip\.json"):
            Clip(folder)


# ---------------------------------------------------------------------------- many processes


def test_a_process_opens_its_own_archives_also_of_a_clip_that_was_pickled(folder, monkeypatch):
    clip = Clip(folder)
    mine = clip._archive("rgb.zip")
    assert clip._archive("rgb.zip") is mine
    monkeypatch.setattr("src.data.files.os.getpid", lambda: -7)
    assert clip._archive("rgb.zip") is not mine
    copy = pickle.loads(pickle.dumps(clip))
    np.testing.assert_array_equal(copy.image(3), clip.image(3))


def test_many_clips_need_no_more_files_than_there_may_be(folder):
    """340 clips of three archives each met the usual limit of 1,024 open files."""
    clips = [Clip(folder) for _ in range(40)]
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    open_now = max(map(int, os.listdir("/proc/self/fd")))
    resource.setrlimit(resource.RLIMIT_NOFILE, (open_now + 20, limits[1]))
    clip_module.ARCHIVES.__init__()
    try:
        for clip in [*clips, *clips]:
            assert clip.image(0).shape == (32, 64, 3)
            assert clip.semantics(0).shape == SHAPE
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_an_archive_that_a_thread_still_reads_is_not_closed(folder, monkeypatch):
    """The card of a dataset reads its clips from several threads."""
    archives = OpenArchives()
    mine = archives.get("mine", lambda: np.load(folder / "occupancy.npz"))
    monkeypatch.setattr("src.data.files.resource.getrlimit", lambda _: (2, 2))
    other = archives.get("other", lambda: np.load(folder / "occupancy.npz"))
    assert archives.get("other", lambda: None) is other
    assert archives.get("mine", lambda: None) is None, "it was let go"
    assert mine["semantics_000000"].shape == SHAPE


# ------------------------------------------------------------- what says nothing about the bytes


@pytest.fixture
def as_nobody():
    """Runs as a user that owns nothing, where the tests run as root."""
    if os.getuid():
        yield
        return
    os.seteuid(65534)
    yield
    os.seteuid(0)


def read_both(folder):
    Clip(folder).semantics(0)
    recorded_sums(folder)


@pytest.mark.parametrize("name", ["occupancy.npz", "frames.csv", SUMS])
def test_a_file_that_may_not_be_read_is_not_called_damaged(folder, name, request):
    for path in (folder, *folder.parents):
        if os.access(path, os.W_OK) and path.owner() == folder.owner():
            path.chmod(0o755)
    (folder / name).chmod(0)
    request.getfixturevalue("as_nobody")
    with pytest.raises(UserError, match=f"{name}: .* denied.* permission to read") as told:
        read_both(folder)
    assert "delete" not in str(told.value)


@pytest.mark.parametrize(
    ("code", "way_out"),
    [
        (errno.EMFILE, "ulimit"),
        (errno.ESTALE, "may be sound"),
        (errno.EIO, "may be sound"),
        (errno.ENOMEM, "memory"),
    ],
)
def test_trouble_of_the_system_is_not_called_damage(folder, monkeypatch, code, way_out):
    def refuse(*_):
        raise OSError(code, os.strerror(code))

    clip = Clip(folder)
    monkeypatch.setattr("numpy.load", refuse)
    with pytest.raises(UserError, match=way_out) as told:
        clip.semantics(0)
    assert "delete" not in str(told.value)
