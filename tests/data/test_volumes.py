"""Cost volumes beside the clips: computed once, and of these very images, poses and settings."""

import shutil

import pytest
import torch

from src.data.clip import Clip
from src.data.dataset import OccupancyDataset
from src.data.volumes import FOLDER, computed_volume, file_of, keep_volumes
from src.errors import UserError
from src.parallax import Parallax
from tests.synthetic import write_clip

AGES_S = [0.2, 0.4]


@pytest.fixture
def clip(clips, tmp_path):
    folder = shutil.copytree(clips["suburb/clip00"].folder, tmp_path / "suburb/clip00")
    return Clip(folder)


def sample_of(clip, frame, parallax, **settings):
    clips, place = {"suburb/clip00": clip}, ("suburb/clip00", frame)
    settings = {"frames": 3, "history_step_s": 0.2, "parallax": parallax, **settings}
    return OccupancyDataset(clips, [place], **settings)[0]


def test_a_sample_has_the_volume_of_its_current_frame(clip):
    parallax = Parallax(AGES_S)
    found = sample_of(clip, 12, parallax)["parallax"]
    assert found.equal(computed_volume(parallax, clip, [10, 11, 12]))
    assert found.any()


def test_a_clip_begins_without_one(clip):
    first, second = (sample_of(clip, n, Parallax(AGES_S))["parallax"] for n in (0, 1))
    assert not first.any()
    assert second.equal(computed_volume(Parallax(AGES_S), clip, [0, 1]))


def test_what_is_kept_is_what_is_computed(clip, monkeypatch):
    parallax = Parallax(AGES_S)
    fresh = [sample_of(clip, n, parallax)["parallax"] for n in (0, 1, 12)]
    keep_volumes(parallax, [clip])
    monkeypatch.setattr("src.data.volumes.computed_volume", lambda *_: pytest.fail("once more"))
    kept = [sample_of(clip, n, parallax)["parallax"] for n in (0, 1, 12)]
    assert all(map(torch.equal, kept, fresh))


def test_where_none_can_be_kept_each_is_computed_and_that_is_said(clip, monkeypatch, capsys):
    monkeypatch.setattr("os.access", lambda *_: False)
    keep_volumes(Parallax(AGES_S), [clip])
    assert "parallax/suburb: cannot be written to, so every epoch" in capsys.readouterr().out
    assert not (clip.folder.parents[1] / FOLDER).exists()
    assert sample_of(clip, 12, Parallax(AGES_S))["parallax"].any()


def test_those_of_other_images_or_settings_are_made_again(clip):
    keep_volumes(Parallax(AGES_S), [clip])
    (kept,) = (clip.folder.parents[1] / FOLDER / "suburb").iterdir()
    assert kept == file_of(Parallax(AGES_S), clip)
    for settings in ({"window": 5}, {"per_bin": 1}, {"projection": "level"}):
        other = Parallax(AGES_S, **settings)
        assert file_of(other, clip) != kept
    keep_volumes(other, [clip])
    assert kept.is_file(), "the rungs of a ladder do not take each other's"

    shutil.rmtree(clip.folder)
    write_clip(clip.folder, capture_hz=5, seed=7)
    changed = Clip(clip.folder)
    keep_volumes(Parallax(AGES_S), [changed])
    of_both = {file_of(Parallax(AGES_S), changed), file_of(other, clip)}
    assert {*kept.parent.iterdir()} == of_both
    assert kept not in of_both


def test_a_strict_history_hides_the_past_from_parallax_too(clip):
    parallax = Parallax(AGES_S)
    keep_volumes(parallax, [clip])
    open_, strict = (
        sample_of(clip, 50, parallax, history=history)["parallax"] for history in ("open", "strict")
    )
    assert open_.any()
    assert not strict.any(), "the frame at 10 s is the first one of its part"


def test_an_age_between_frames_is_refused(clip):
    with pytest.raises(UserError, match=r"^data\.parallax\.ages_s: \[0\.3\].*0\.2 s.*parallax=off"):
        sample_of(clip, 5, Parallax([0.3]))


def test_a_broken_file_of_them_is_named_with_the_way_out(clip):
    parallax = Parallax(AGES_S)
    keep_volumes(parallax, [clip])
    path = file_of(parallax, clip)
    whole = path.read_bytes()
    for broken in (b"", whole[:200], whole[: len(whole) // 2]):
        path.write_bytes(broken)
        with pytest.raises(UserError, match=rf"^{path}: cannot be read .*; delete it, and it"):
            sample_of(clip, 12, parallax)
