"""task=generate in shards: each makes its share, and the last one finishes the data set."""

import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from src.data.manifest import MANIFEST, read_manifest
from src.data.shards import record_of
from src.errors import UserError
from src.report.card import CARD
from src.tasks.dataset import make_dataset, ready_dataset, root_of
from src.tasks.generate import generate
from tests.synthetic import compose_config, mini_overrides, write_clip


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Composes the settings of a shard; clips are synthetic."""
    monkeypatch.setattr("src.sim.generate._make_all", write_clips)

    def configured(*words):
        return compose_config(*mini_overrides(tmp_path, "sim.clips_per_town=2", *words))

    return configured


def write_clips(plans, sim, root):
    for plan in plans:
        write_clip(root / plan.clip_id, sim["capture_hz"], seed=plan.index)


def shard(number, shards, *words):
    return f"sim.shards={shards}", f"sim.shard={number}", *words


def test_the_last_shard_writes_one_manifest_of_all_clips(config, capsys):
    first, second = (config(*shard(number, 2)) for number in (0, 1))
    root, record = root_of(first), record_of(root_of(first).parent, "tiny")
    assert root_of(second) == root
    generate(first)
    assert "shard 0 of 2, 2 clips made now; of 4 clips 2 still to" in flat(capsys)
    assert record.is_file()
    assert not (root / MANIFEST).exists()
    generate(second)
    assert "shard 1 of 2, 2 clips made now; of 4 clips all there" in flat(capsys)
    assert list(read_manifest(root)["clips"]) == [
        *("downtown/clip00", "downtown/clip01", "suburb/clip00", "suburb/clip01")
    ]
    assert not (root / CARD).exists(), "which task=card draws"
    assert not record.exists()
    # Without shards the same bytes come out, and a shard of a finished data set does nothing.
    sharded = (root / MANIFEST).read_bytes()
    assert make_dataset(config())[0] == 0
    assert make_dataset(first) == (0, [])
    assert (root / MANIFEST).read_bytes() == sharded


def flat(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_a_shard_with_other_settings_is_refused_before_it_makes_anything(config):
    make_dataset(config(*shard(0, 2)))
    other = config(*shard(1, 2, "sim.seed=3"))
    with pytest.raises(UserError, match=r"sim\.seed: this shard has 3, .* have 0; .*delete"):
        make_dataset(other)
    assert not root_of(other).exists()
    with pytest.raises(UserError, match=r"sim\.shards: this is one of 3 shards.* of 2"):
        make_dataset(config(*shard(1, 3)))


def test_without_shards_what_shards_left_is_completed(config):
    make_dataset(config(*shard(1, 3)))
    whole = config()
    assert make_dataset(whole) == (3, [])
    assert not record_of(root_of(whole).parent, "tiny").exists()


def test_training_does_not_begin_on_a_part_of_the_data(config):
    part = config(*shard(0, 2))
    make_dataset(part)
    with pytest.raises(UserError, match=r"sim\.shards: only task=generate .* drop the key"):
        ready_dataset(part)


def test_the_plan_is_printed_without_making_anything(config, capsys):
    cfg = config("sim.dry_run=true")
    generate(cfg)
    said = flat(capsys)
    assert "4 clips, 120 frames" in said
    assert "train 75 / val 9 / test 36" in said
    assert "MiB on disk" in said
    assert "minutes on" in said
    assert not root_of(cfg).exists()


def test_the_record_is_plain_json(config):
    cfg = config(*shard(0, 2))
    make_dataset(cfg)
    assert json.loads(record_of(root_of(cfg).parent, "tiny").read_text())["shards"] == 2


def test_of_two_jobs_that_need_the_same_data_one_makes_them_and_the_other_waits(
    config, monkeypatch, capsys
):
    cfg, begun, may_end, made = config(), threading.Event(), threading.Event(), []

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
        said, deadline = "", time.monotonic() + 30
        while "waiting for it" not in said and time.monotonic() < deadline:
            said += flat(capsys)
        may_end.set()
        assert first.result() == second.result() == root_of(cfg)
    assert "another process is making this data set; waiting for it" in said
    assert made == [4, 0]
