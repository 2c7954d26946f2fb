"""task=check as its user meets it: every flipped byte is found, and mended clip by clip."""

import errno
import os
import shutil
from itertools import cycle

import numpy as np
import pytest

from src.data.clip import SUMS, Clip, unfinished
from src.data.manifest import MANIFEST
from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import COLORS
from src.report import animation
from src.report.check_sheet import overlaid
from src.report.voxels import COLOR_SHARE, EDGE_SHARE
from src.tasks.check import CARD_SUMS, check
from src.tasks.dataset import make_dataset, root_of
from studies.card.page import CARD, write_card
from tests.synthetic import BOXES, GROUND_RGB, SKY_RGB, generated_config, write_clip


@pytest.fixture(scope="module", autouse=True)
def short_flight():
    """An animation of two frames: its own test makes the whole one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(animation, "SECONDS", 0.8)
        yield


@pytest.fixture(scope="module")
def original(mini_dataset, tmp_path_factory):
    """The small dataset, finished with its card; not to be changed."""
    config = generated_config(tmp_path_factory.mktemp("data"))
    root = root_of(config)
    shutil.copytree(mini_dataset, root)
    make_dataset(config)
    write_card(root)
    return root


@pytest.fixture
def config(tmp_path):
    """The configuration that it was made with, for another folder."""
    return generated_config(tmp_path)


@pytest.fixture
def root(original, config):
    """A copy of it that may be damaged."""
    shutil.copytree(original, root_of(config))
    return root_of(config)


def test_where_no_sheet_can_be_written_the_way_out_is_named(root, config, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(UserError, match=r"^task\.sheets: .* task\.sheets=false checks without"):
        check(config, mend=False, sheets=True)


def contents(root):
    return {
        path.relative_to(root): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    }


def flip(path, share=0.5):
    data = bytearray(path.read_bytes())
    data[int(share * (len(data) - 1))] ^= 1
    path.write_bytes(bytes(data))


def test_a_sound_dataset_passes_and_nothing_is_written(root, config, capsys):
    before = contents(root)
    assert all((root / clip / SUMS).is_file() for clip in ("suburb/clip00", "suburb/clip01"))
    check(config, mend=False, sheets=False)
    assert "2 clips" in capsys.readouterr().out
    assert contents(root) == before


def test_a_flipped_byte_in_any_file_is_found_and_the_file_named(root, config, capsys):
    # A flipped byte is the first one, the last one or one between them, in turn.
    for name, share in zip(contents(root), cycle((0.0, 0.37, 1.0))):
        data = (root / name).read_bytes()
        flip(root / name, share)
        with pytest.raises(UserError, match=r"task\.mend=true"):
            check(config, mend=False, sheets=False)
        # Of a list of sums one may find the file that it lists wrongly.
        named = str(root / name) if name.name != SUMS else str(root)
        assert named in capsys.readouterr().out, (name, share)
        (root / name).write_bytes(data)


@pytest.mark.slow
def test_mending_makes_the_damaged_clip_again_and_no_other(root, config, original, capsys):
    for path in (root / "suburb/clip01").iterdir():
        flip(path)
    untouched = (root / "suburb/clip00").stat().st_ino
    check(config, mend=True, sheets=False)
    assert "mended: suburb/clip01" in capsys.readouterr().out
    assert contents(root) == contents(original)
    assert (root / "suburb/clip00").stat().st_ino == untouched


def test_a_damaged_manifest_and_card_are_written_again(root, config, original, capsys):
    for name in (MANIFEST, CARD, CARD_SUMS):
        flip(root / name)
    made = {path: path.stat().st_ino for path in root.glob("suburb/*")}
    check(config, mend=True, sheets=False, card=write_card)
    assert contents(root) == contents(original)
    assert made == {path: path.stat().st_ino for path in root.glob("suburb/*")}
    assert not unfinished(root / "suburb/clip00").exists()


def test_a_dataset_that_is_named_or_not_there_is_refused(config, tmp_path):
    with pytest.raises(UserError, match=r"manifest\.json: .*task=generate"):
        check(config, mend=False, sheets=False)
    config.paths.dataset = str(tmp_path)
    with pytest.raises(UserError, match=r"task\.mend.*paths\.dataset"):
        check(config, mend=True, sheets=False)


def test_there_is_a_sheet_for_every_town(root, config):
    check(config, mend=False, sheets=True)
    assert [path.name for path in (root / "check").iterdir()] == ["suburb.jpg"]
    # They are no part of the dataset.
    check(config, mend=False, sheets=False)


def test_colors_lie_on_their_objects(tmp_path):
    """A red box and a green one on grey ground: whatever is red is tinted as a building."""
    write_clip(tmp_path / "suburb/clip00", grid=VoxelGrid(shape=(100, 100, 60)))
    clip = Clip(tmp_path / "suburb/clip00")

    for frame in (0, 7, 20):
        image = clip.image(frame).astype(float)
        # What was mixed in, but for the edges of voxels, which are darker.
        tint = (overlaid(clip, frame) - (1 - COLOR_SHARE) * image) / COLOR_SHARE
        # The ground goes on beyond the grid.
        for color, name, least in ((BOXES[0][3], "building", 0.9), (GROUND_RGB, "ground", 0.7)):
            shown = np.abs(image - color).max(axis=-1) < 12
            share = tint[shown] / COLORS[name]
            is_tinted = [(np.abs(share - each) < 0.05).all(-1) for each in (1, 1 - EDGE_SHARE)]
            assert shown.sum() > 100
            assert (is_tinted[0] | is_tinted[1]).mean() > least, (frame, name)
        sky = (np.abs(image - SKY_RGB).max(axis=-1) < 12) & (np.abs(image - tint).max(axis=-1) > 9)
        assert sky.mean() < 0.03


@pytest.mark.parametrize("name", [SUMS, "occupancy.npz"])
def test_what_the_system_does_not_let_be_read_is_not_mended(root, config, monkeypatch, name):
    """Such a clip may be sound: a passing fault of a disk would cost it."""
    clip = next(root.glob(f"*/*/{SUMS}")).parent
    before = {path: path.stat().st_ino for path in clip.iterdir()}

    def refusing(path, *arguments, **options):
        if str(path) == str(clip / name):
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        return opened(path, *arguments, **options)

    opened = open
    monkeypatch.setattr("builtins.open", refusing)
    monkeypatch.setattr("io.open", refusing)
    with pytest.raises(UserError, match="may be sound"):
        check(config, sheets=False, mend=True)
    assert {path: path.stat().st_ino for path in clip.iterdir()} == before
