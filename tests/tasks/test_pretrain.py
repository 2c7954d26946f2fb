"""task=pretrain: weights for the image encoder, the same however often it was interrupted."""

import hashlib
import os
from pathlib import Path

import pytest
import torch

from src.data.dataset import OccupancyDataset
from src.errors import UserError
from src.models.backbone import ResNet
from src.models.image_pretraining import ImagePretraining
from src.models.weights import ORIGIN, read_encoder
from src.tasks.dataset import data_of, finished_dataset
from src.tasks.fit import fit
from src.tasks.pretrain import pretrain, require_unseen, write_encoder
from tests.synthetic import compose_config, mini_overrides, untrained, write_dataset

SETTINGS = {"epochs": 2, "batch_size": 4, "lr": 2e-3}


class Stop(Exception):
    """Stands for whatever ends a run."""


@pytest.fixture(scope="module")
def cfg(tmp_path_factory):
    words = mini_overrides(tmp_path_factory.mktemp("place"), "trainer.accelerator=cpu")
    cfg = compose_config(*words)
    write_dataset(cfg)
    return cfg


@pytest.fixture(scope="module")
def weights(cfg, tmp_path_factory):
    """The file of an undisturbed pretraining."""
    folder = tmp_path_factory.mktemp("whole")
    pretrain(cfg, str(folder), **SETTINGS)
    return written(folder)


def written(folder):
    (path,) = folder.glob("tiny-*/*.pth")
    return path


def test_the_file_is_named_after_its_content_and_a_run_begins_with_it(weights, cfg):
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    assert weights.name == f"image_encoder-{digest[:8]}.pth"
    trained, _ = read_encoder(weights)
    fresh = ResNet(cfg.size.backbone_depth, cfg.size.backbone_width)
    assert fresh.state_dict().keys() == trained.keys()
    cfg = cfg.copy()
    cfg.model.backbone.weights = str(weights)
    data = data_of(cfg, finished_dataset(cfg))
    begins = untrained(cfg, data).network.backbone.state_dict()
    assert all(begins[name].equal(value) for name, value in trained.items())


def test_it_goes_on_where_it_was_interrupted(weights, cfg, tmp_path, monkeypatch):
    step = ImagePretraining.training_step

    def stopping(self, batch, index):
        if self.current_epoch == 1 and index == 1:
            raise Stop
        return step(self, batch, index)

    with monkeypatch.context() as patched:
        patched.setattr(ImagePretraining, "training_step", stopping)
        with pytest.raises(Stop):
            pretrain(cfg, str(tmp_path), **SETTINGS)
    assert not list(tmp_path.rglob("*.pth"))
    steps = []
    monkeypatch.setattr(
        ImagePretraining, "training_step", lambda *a: steps.append(a[0].current_epoch) or step(*a)
    )
    pretrain(cfg, str(tmp_path), **SETTINGS)
    assert set(steps) == {1}
    again = written(tmp_path)
    assert again.name == weights.name
    assert again.read_bytes() == weights.read_bytes()


def test_a_broken_checkpoint_is_one_line(cfg, tmp_path):
    pretrain(cfg, str(tmp_path), **{**SETTINGS, "epochs": 1})
    (checkpoint,) = tmp_path.rglob("last.ckpt")
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(UserError, match=r"last\.ckpt is no readable checkpoint"):
        pretrain(cfg, str(tmp_path), **{**SETTINGS, "epochs": 1})


def test_the_file_does_not_depend_on_the_process_that_writes_it(cfg, tmp_path, monkeypatch):
    """A sweep that is given a file of another name begins anew."""
    backbone, names = torch.nn.Linear(2, 2), set()
    data = data_of(cfg, finished_dataset(cfg))
    for process in (11, 22):
        monkeypatch.setattr(os, "getpid", lambda process=process: process)
        names.add(write_encoder(tmp_path, backbone, data).name)
    assert len(names) == 1


def with_test_clips(cfg, *clips):
    cfg = cfg.copy()
    cfg.data.test_clips = list(clips)
    return data_of(cfg, finished_dataset(cfg))


def test_an_encoder_that_has_learnt_a_clip_is_not_tested_on_it(weights, cfg):
    (held_out,) = cfg.data.test_clips
    require_unseen(str(weights), data_of(cfg, finished_dataset(cfg)))
    require_unseen(str(weights), with_test_clips(cfg))
    others = with_test_clips(cfg, "downtown/clip00")
    assert held_out != "downtown/clip00"
    with pytest.raises(UserError, match=r"\.pth was trained on downtown/clip00, which this run"):
        require_unseen(str(weights), others)
    for nothing_known in (None, "imagenet", str(weights.with_name("other.pth"))):
        require_unseen(nothing_known, others)


def test_of_a_published_file_nothing_is_known_and_of_ours_it_must_be(weights, cfg, tmp_path):
    state, _ = read_encoder(weights)
    others = with_test_clips(cfg, "downtown/clip00")
    torch.save(state, tmp_path / "resnet18.pth")
    require_unseen(str(tmp_path / "resnet18.pth"), others)
    torch.save(state, tmp_path / "image_encoder.pth")
    with pytest.raises(UserError, match=r"image_encoder\.pth does not say which flights"):
        require_unseen(str(tmp_path / "image_encoder.pth"), others)


def test_a_run_that_holds_out_other_clips_is_refused_before_it_begins(weights, cfg):
    other = cfg.copy()
    other.model.backbone.weights, other.data.test_clips = str(weights), ["downtown/clip00"]
    with pytest.raises(UserError, match="was trained on downtown/clip00"):
        fit(other)
    assert not Path(cfg.paths.run).exists()


def test_flights_of_another_data_set_are_others_whatever_their_names(weights, cfg, tmp_path):
    state, origin = read_encoder(weights)
    path = tmp_path / weights.name
    torch.save({"state_dict": state, ORIGIN: {**origin, "dataset": "tiny-0123"}}, path)
    require_unseen(str(path), with_test_clips(cfg, "downtown/clip00"))


def test_a_file_that_cannot_be_read_is_named(cfg, tmp_path):
    (tmp_path / "some.pth").write_text("{}")
    with pytest.raises(UserError, match=r"some\.pth is no readable file of weights"):
        require_unseen(str(tmp_path / "some.pth"), data_of(cfg, finished_dataset(cfg)))


def test_without_a_data_set_nothing_is_made(cfg, tmp_path):
    other = cfg.copy()
    other.paths.data = str(tmp_path / "data")
    with pytest.raises(UserError, match=r"manifest\.json: not found"):
        pretrain(other, str(tmp_path), **SETTINGS)
    assert not list(tmp_path.iterdir())


def test_an_epoch_may_be_shortened(cfg, tmp_path, monkeypatch):
    steps, step = [], ImagePretraining.training_step
    monkeypatch.setattr(
        ImagePretraining, "training_step", lambda *a: steps.append(a[0].current_epoch) or step(*a)
    )
    pretrain(cfg, str(tmp_path), **SETTINGS, limit_train_batches=1)
    assert steps == [0, 1]


def test_another_schedule_leaves_the_file_where_it_is(weights, cfg):
    place = weights.parents[1]
    pretrain(cfg, str(place), **{**SETTINGS, "epochs": 1})
    assert weights.is_file()
    assert len(list(place.glob("tiny-*/*.pth"))) == 2


def test_no_frame_of_the_test_split_is_read(cfg, tmp_path, monkeypatch):
    read = []
    sample = OccupancyDataset._sample
    monkeypatch.setattr(
        OccupancyDataset,
        "_sample",
        lambda self, clip, now, past: read.append((clip, now)) or sample(self, clip, now, past),
    )
    pretrain(cfg, str(tmp_path), **SETTINGS)
    split = data_of(cfg, finished_dataset(cfg)).split
    assert set(read) == {*split["train"], *split["val"]}


def test_another_backbone_is_refused(cfg, tmp_path):
    words = ["model/backbone=huggingface", "model.backbone.pretrained=false"]
    other = compose_config("scale=tiny", *words)
    other.paths = cfg.paths
    with pytest.raises(UserError, match=r"^model/backbone: .* resnet"):
        pretrain(other, str(tmp_path), **SETTINGS)


def test_a_report_does_not_take_it_for_a_run():
    """A report takes every folder with a configuration that lies below its scale's runs."""
    cfg = compose_config("task=pretrain", "scale=tiny", "paths.runs=here/runs")
    assert Path("here/runs") not in Path(cfg.task.out).parents
