"""The generator as a whole: the same bytes whatever happens, and labels that agree with depth."""

import json
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from src.data.check import agreement_of, problems_of, shares_of
from src.data.clip import SUMS, Clip
from src.data.files import sha256_of
from src.data.manifest import DatasetSpec
from src.errors import UserError
from src.ontology import ACTOR_TYPES, FREE, UNKNOWN
from src.sim.clip_maker import ClipMaker
from src.sim.generate import LOCK, generate
from src.sim.plan import plan_clips
from src.sim.staging import place_of
from tests import sessions
from tests.sessions import running_in

TOWN_SEEDS = ({}, {"town_seeds": 1}, {"town_seeds": 2})
DRIVER = """
import json, pathlib, sys
from src.sim.generate import generate
generate(json.loads(sys.argv[1]), pathlib.Path(sys.argv[2]))
"""


def hashes(root):
    """Clip to the hash of its sums, which name every byte."""
    folders = sorted(root.glob("*/clip*"))
    return {str(folder.relative_to(root)): sha256_of(folder / SUMS) for folder in folders}


def start(sim, root):
    """The generator as a process of its own."""
    return sessions.start("-c", DRIVER, json.dumps(sim), str(root))


# The patience is for a machine that does much else at the same time.
def wait_for(condition, patience_s=60.0):
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def workers_of(process):
    """Process ids of the spawned workers of a generator."""
    running = running_in(process.pid)
    return [pid for pid, command in running.items() if "spawn_main" in command]


def kill(process):
    """Kills a generator, and returns when its workers are gone: which there were."""
    workers = workers_of(process)
    process.kill()
    process.communicate()
    wait_for(lambda: not running_in(process.pid))
    return workers


# ------------------------------------------------------------------------------- what is made


def test_clips_are_whole_and_nothing_is_left_over(mini_dataset, mini_sim):
    plans = plan_clips(mini_sim)
    assert list(hashes(mini_dataset)) == [plan.clip_id for plan in plans]
    assert not list(mini_dataset.glob("*/.*"))
    for plan in plans:
        assert list(problems_of(mini_dataset / plan.clip_id)) == []
        clip = Clip(mini_dataset / plan.clip_id)
        assert (clip.meta.town, clip.meta.weather) == (plan.town, plan.weather)
        assert len(clip) == 30
        assert clip.frames["time_s"].to_numpy() == pytest.approx(np.arange(30) / 2.5)


def test_a_frame_holds_what_the_contract_says(mini_dataset):
    clip = Clip(mini_dataset / "suburb/clip00")
    labels = np.stack([clip.semantics(frame) for frame in range(len(clip))])
    visible = np.stack([clip.visible(frame) for frame in range(len(clip))])
    classes = set(np.unique(labels))
    assert labels.shape == (30, 25, 25, 15)
    assert classes <= {*range(FREE + 1), UNKNOWN}
    assert len(classes - {FREE, UNKNOWN}) >= 5
    assert (labels != UNKNOWN).mean() > 0.1

    assert not visible[labels == UNKNOWN].any()
    assert visible[labels == FREE].any()
    assert clip.image(3).shape == (64, 96, 3)
    attitude_rad = clip.frames[["roll_rad", "pitch_rad"]].to_numpy()
    assert np.degrees(np.abs(attitude_rad)).max() > 5


def test_actors_are_those_of_the_instance_image(mini_dataset):
    for clip in (Clip(mini_dataset / "suburb" / name) for name in ("clip00", "clip01")):
        assert (clip.actors["class_id"] == clip.actors["type"].map(ACTOR_TYPES)).all()
        for frame, rows in clip.actors.groupby("frame"):
            instance, class_id = clip.aux("instance", frame), clip.aux("class", frame)
            for row in rows.itertuples():
                assert row.visible_pixels == (instance == row.actor_id).sum()
                assert (class_id[instance == row.actor_id] == row.class_id).all()
            assert set(np.unique(instance)) <= {-1, 0, *rows["actor_id"]}
            np.testing.assert_array_equal(instance == -1, np.isinf(clip.aux("depth", frame)))


def test_labels_agree_with_depth_and_class(mini_dataset):
    total = Counter()
    for clip in (Clip(mini_dataset / clip_id) for clip_id in hashes(mini_dataset)):
        for frame in range(len(clip)):
            total.update(agreement_of(clip, frame))
    assert total["pixels"] > 50_000
    shares = shares_of(total)
    assert shares["pixels in an occupied voxel"] >= 0.97
    assert shares["pixels in a voxel of their class"] >= 0.90
    assert shares["free voxels that hold a pixel's point"] <= 0.01


# ------------------------------------------------------------------------------ the same bytes


@pytest.mark.slow
def test_a_clip_does_not_depend_on_the_others_and_another_seed_makes_others(
    mini_dataset, mini_sim, tmp_path
):
    # Alone in its dataset, the first clip has the bytes that it has beside another one.
    wanted = mini_sim | {"clips_per_town": 1}
    generate(wanted, tmp_path / "alone")
    generate(wanted | {"seed": 1}, tmp_path / "other")
    alone, other = hashes(tmp_path / "alone"), hashes(tmp_path / "other")
    assert alone["suburb/clip00"] == hashes(mini_dataset)["suburb/clip00"]
    assert other["suburb/clip00"] != alone["suburb/clip00"]
    first, second = (Clip(tmp_path / name / "suburb/clip00") for name in ("alone", "other"))
    assert (first.frames["x_m"] - second.frames["x_m"]).abs().max() > 1


@pytest.mark.slow
def test_killed_at_any_point_it_goes_on_to_the_same_bytes(mini_dataset, mini_sim, tmp_path):
    """First in the middle of a clip, then at random moments."""
    root, sim, hit = tmp_path / "data", mini_sim | {"workers": 1}, 0
    process = start(sim, root)
    wait_for(lambda: list(root.glob("*/.clip*.part/rgb.zip")))
    assert kill(process)
    assert list(root.glob("*/.clip*.part"))

    for moment_s in np.random.default_rng(0).uniform(0.3, 9.0, 10):
        process = start(sim, root)
        time.sleep(moment_s)
        hit += process.poll() is None
        kill(process)
    assert hit >= 5
    generate(mini_sim, root)
    assert hashes(root) == hashes(mini_dataset)
    assert {path.name for path in root.rglob(".*")} == {LOCK}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("killed", "by", "message"),
    [
        ("worker", signal.SIGKILL, "sim.workers"),
        # After Ctrl-C nobody waits for the clips to be finished either.
        ("generator", signal.SIGINT, "KeyboardInterrupt"),
    ],
)
def test_a_death_leaves_nothing_running_and_nothing_partial(
    mini_sim, tmp_path, killed, by, message
):
    root = tmp_path / "data"
    process = start(mini_sim, root)
    wait_for(lambda: len(list(root.glob("*/.clip*.part"))) == 2)
    os.kill(workers_of(process)[0] if killed == "worker" else process.pid, by)

    assert message in process.communicate(timeout=60)[0].strip().splitlines()[-1]
    wait_for(lambda: not running_in(process.pid))
    assert not list(root.glob("*/*"))


def test_a_failing_clip_ends_it_and_leaves_nothing(mini_sim, tmp_path):
    (tmp_path / "suburb").write_text("a file where a folder should be")
    with pytest.raises(OSError, match="suburb") as error:
        generate(mini_sim | {"workers": 1}, tmp_path)
    assert str(tmp_path / "suburb") in str(error.value)
    assert not multiprocessing.active_children()
    assert {path.name for path in tmp_path.iterdir()} == {"suburb", LOCK}


def test_what_is_there_is_left_alone_and_no_worker_starts(mini_dataset, mini_sim, monkeypatch):
    monkeypatch.setattr("src.sim.generate.require_renderer", lambda _: pytest.fail("not needed"))
    # Neither a byte nor a date changes.
    before = {path: path.stat().st_mtime_ns for path in mini_dataset.rglob("*")}
    assert generate(mini_sim, mini_dataset) == 0
    assert before == {path: path.stat().st_mtime_ns for path in mini_dataset.rglob("*")}


def test_without_pybullet_nothing_is_begun(mini_sim, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(UserError, match=r"^pybullet .*make setup") as error:
        generate(mini_sim, tmp_path / "data")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "data").exists()


def test_a_town_is_drawn_anew_for_as_many_clips_as_are_asked_for(mini_sim):
    """The first drawing is the one that there always was."""
    sim = {**mini_sim, "clips_per_town": 2, "towns": ["suburb"]}
    plans = plan_clips(sim)
    one, two = (ClipMaker({**sim, "town_seeds": n}, Path()) for n in (1, 2))
    tracks = [[maker.stage(plan)[0].position_m for plan in plans] for maker in (one, two)]
    np.testing.assert_array_equal(tracks[0][0], tracks[1][0])
    assert not np.array_equal(tracks[0][1], tracks[1][1])
    assert place_of("suburb", 0, 1).whole is not place_of("suburb", 0).whole
    with pytest.raises(UserError, match=r"sim\.town_seeds: 0 is too small"):
        plan_clips({**sim, "town_seeds": 0})


def test_datasets_of_one_drawing_a_town_keep_their_names(mini_sim):
    without = {key: value for key, value in mini_sim.items() if key != "town_seeds"}
    names = [DatasetSpec.of("tiny", {**without, **more}).digest for more in TOWN_SEEDS]
    assert names[0] == names[1] != names[2]
