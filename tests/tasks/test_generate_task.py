"""task=generate in shards: each makes its share, and the last one finishes the dataset."""

import json
import queue
import re
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from src.data.manifest import MANIFEST, read_manifest
from src.data.shards import record_of
from src.errors import UserError
from src.tasks.dataset import make_dataset, ready_dataset, root_of
from src.tasks.generate import generate
from tests.synthetic import compose_config, mini_overrides, write_clip


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Composes the settings of a shard; clips are synthetic."""
    monkeypatch.setattr("src.sim.generate._make_all", write_clips)

    def configured(*overrides):
        return compose_config(*mini_overrides(tmp_path, "sim.clips_per_town=2", *overrides))

    return configured


def write_clips(plans, sim, root):
    for plan in plans:
        write_clip(root / plan.clip_id, sim["capture_hz"], seed=plan.index)


def shard(number, shards, *overrides):
    return f"sim.shards={shards}", f"sim.shard={number}", *overrides


def test_the_last_shard_writes_one_manifest_of_all_clips(config, capsys):
    first, second = (config(*shard(number, 2)) for number in (0, 1))
    root, record = root_of(first), record_of(root_of(first).parent, "tiny")

    assert root_of(second) == root
    generate(first)
    assert re.search("shard 0 of 2, 2 clips .* 4 clips 2 ", flat(capsys))
    assert json.loads(record.read_text())["sim.shards"] == 2
    assert not (root / MANIFEST).exists()
    generate(second)
    assert re.search("shard 1 of 2, 2 clips .* 4 clips all", flat(capsys))
    assert list(read_manifest(root)["clips"]) == [
        *("downtown/clip00", "downtown/clip01", "suburb/clip00", "suburb/clip01")
    ]
    assert not (root / "README.md").exists(), "which task=card draws"
    assert not record.exists()
    # Without shards the same bytes come out, and a shard of a finished dataset does nothing.
    sharded = (root / MANIFEST).read_bytes()
    assert make_dataset(config())[0] == 0
    assert make_dataset(first) == (0, [])
    assert (root / MANIFEST).read_bytes() == sharded


def flat(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_a_shard_with_other_settings_is_refused_before_it_makes_anything(config):
    make_dataset(config(*shard(0, 2)))
    other = config(*shard(1, 2, "sim.seed=3"))
    with pytest.raises(UserError, match=r"sim\.seed: .* 3.* 0"):
        make_dataset(other)
    assert not root_of(other).exists()
    with pytest.raises(UserError, match=r"sim\.shards: .* 3, .* 2;"):
        make_dataset(config(*shard(1, 3)))


def test_what_shards_left_is_no_data_to_train_on_and_is_completed_without_shards(config):
    part, whole = config(*shard(1, 3)), config()
    make_dataset(part)
    with pytest.raises(UserError, match=r"sim\.shards: .*task=generate"):
        ready_dataset(part)
    assert make_dataset(whole) == (3, [])
    assert not record_of(root_of(whole).parent, "tiny").exists()


def test_the_plan_is_printed_without_making_anything(config, capsys):
    cfg = config("sim.dry_run=true")
    generate(cfg)
    lines = flat(capsys)
    for line in (
        "4 clips, 120 frames",
        "train 75 / val 9 / test 36",
        r"\d MiB",
        r"\d+ s on \d core",
    ):
        assert re.search(line, lines)
    assert not root_of(cfg).exists()


def test_of_two_jobs_that_need_the_same_data_one_makes_them_and_the_other_waits(
    config, monkeypatch
):
    cfg, begun, may_end, made = config(), threading.Event(), threading.Event(), []
    # Where it is said: emptying the captured output while others print could lose a line.
    lines = queue.Queue()
    monkeypatch.setattr("src.locks.say", lines.put)

    def slowly(plans, sim, root):
        made.append(len(plans))
        begun.set()
        assert may_end.wait(timeout=30)
        write_clips(plans, sim, root)

    monkeypatch.setattr("src.sim.generate._make_all", slowly)
    with ThreadPoolExecutor(2) as jobs:
        first = jobs.submit(ready_dataset, cfg)
        assert begun.wait(timeout=30)
        second = jobs.submit(ready_dataset, cfg)
        line = lines.get(timeout=30)
        may_end.set()
        assert first.result() == second.result() == root_of(cfg)
    assert "waiting for it" in line
    assert made == [4, 0]


def test_the_labels_to_score_against_are_no_dataset_to_make(config):
    with pytest.raises(UserError, match=r"^dataset: .*paths\.dataset=DIR"):
        root_of(config("dataset=elsewhere"))
