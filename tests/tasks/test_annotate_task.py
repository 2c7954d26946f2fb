"""task=annotate as a command: what it leaves, goes on with, and refuses."""

import numpy as np
import pytest

from src.data.clip import Clip, recorded_sums
from src.data.manifest import read_manifest
from src.recordings import annotate
from src.tasks.annotate import _listing
from tests.recordings import foreign

WORDS = ("task=annotate", "recording=rec", "layout=plain", "scale=tiny", "sim.workers=1")


@pytest.fixture
def here(mini_dataset, tmp_path, monkeypatch):
    """A folder with a recording of two flights, both of one of our clips."""
    first = next(iter(read_manifest(mini_dataset)["clips"]))
    for name in ("a", "b"):
        foreign.write_plain(Clip(mini_dataset / first), tmp_path / "rec" / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def root_of(folder):
    [root] = (folder / "data").glob("rec-*")
    return root


def test_an_interrupted_recording_goes_on_and_ends_the_same(here, run_py, monkeypatch):
    write = annotate._write_clip

    def killed(root, annotator, clip_id, clip):
        if clip_id.startswith("b"):
            raise KeyboardInterrupt
        write(root, annotator, clip_id, clip)

    monkeypatch.setattr(annotate, "_write_clip", killed)
    assert run_py(*WORDS)[0] != 0
    root = root_of(here)
    assert [path.name for path in sorted(root.glob("*/clip*"))] == ["clip00"]
    assert not (root / "manifest.json").exists()
    first = (root / "a/clip00/SHA256SUMS").read_bytes()

    monkeypatch.setattr(annotate, "_write_clip", write)
    status, out, _ = run_py(*WORDS)
    assert status == 0
    assert "1 clips made now, 2 in all" in "\n".join(out)
    assert (root / "a/clip00/SHA256SUMS").read_bytes() == first
    # Both flights are one recording: only their names differ.
    one, other = (recorded_sums(root / name / "clip00") for name in ("a", "b"))
    assert {name for name in one if one[name] != other[name]} == {"clip.json"}
    assert run_py(*WORDS)[1][-2].endswith("0 clips made now, 2 in all")
    # Beside it a plan of our own names it, though it has neither towns nor a seed of ours.
    _, out, _ = run_py("task=generate", "scale=tiny", "sim.dry_run=true")
    assert f"also there: data/{root.name}: 2 clips in a, b, " in "\n".join(out)


def test_a_broken_frame_is_named_and_nothing_of_its_clip_is_left(here, run_py):
    broken = here / "rec/b/rgb/000012.png"
    broken.write_bytes(broken.read_bytes()[:200])
    status, _, errors = run_py(*WORDS)
    assert status == 2
    [line] = errors
    assert str(broken) in line
    assert list(root_of(here).glob("b/*")) == []


def test_other_settings_have_another_dataset_and_the_class_of_a_pixel_follows(here, run_py):
    assert run_py(*WORDS)[0] == 0
    # Everything that stands is vegetation now; what moves has the class of its actor.
    classes = "layout.classes={building: [], ground: [], vegetation: [0,1,2,3,4,5,6,7], car: [], "
    classes += "thin_structure: [], large_vehicle: [], vru: [], general: []}"
    assert run_py(*WORDS, classes, "task.ground_m=0")[0] == 0
    assert len(list((here / "data").glob("rec-*"))) == 2
    labels = [
        {*np.unique(Clip(root / "a/clip00").semantics(5)).tolist()}
        for root in (here / "data").glob("rec-*")
    ]
    assert sorted(bool({0, 1, 3, 7} & each) for each in labels) == [False, True]


def test_what_is_no_recording_is_refused(here, run_py):
    def refused(*words):
        status, _, errors = run_py("task=annotate", "scale=tiny", *words)
        assert status == 2
        [line] = errors
        return line

    assert "recording: name the folder" in refused("layout=plain")
    assert "recording: " in refused("layout=plain", "recording=nowhere")
    assert "layout: skyshield is one of predictions" in refused("recording=rec")
    assert "plane" in refused("recording=rec", "layout=plane")
    assert "no frames.json in it" in refused("recording=rec", "layout=carla")
    assert "data.val_clips/data.test_clips" in refused(
        "recording=rec", "layout=plain", "task.test_clips=[c/clip00]"
    )
    assert not (here / "data").exists()


def test_a_corrected_table_is_another_recording(tmp_path):
    """Of the same size: a header whose columns have changed places."""
    (tmp_path / "poses.csv").write_text("qx,qy,qz,qw")
    (tmp_path / "000000.png").write_bytes(b"1234")
    before = _listing(tmp_path)
    assert _listing(tmp_path) == before
    (tmp_path / "poses.csv").write_text("qw,qx,qy,qz")
    assert _listing(tmp_path) != before
