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
from src.tasks.fit import fit
from src.tasks.pretrain import pretrain, require_unseen, write_encoder
from src.tasks.session import Session
from tests.synthetic import compose_config, mini_overrides, untrained, write_dataset

SETTINGS = {"epochs": 2, "batch_size": 4, "lr": 2e-3}


class Stop(Exception):
    """Stands for whatever ends a run."""


@pytest.fixture(scope="module")
def cfg(tmp_path_factory):
    overrides = mini_overrides(tmp_path_factory.mktemp("place"), "trainer.accelerator=cpu")
    cfg = compose_config(*overrides)
    write_dataset(cfg)
    return cfg


def pretrained(cfg, folder, **settings):
    """Pretrains in a folder, and returns the only file of weights there."""
    pretrain(cfg, str(folder), **{**SETTINGS, **settings})
    (path,) = folder.glob("tiny-*/*.pth")
    return path


@pytest.fixture(scope="module")
def weights(cfg, tmp_path_factory):
    """The file of an undisturbed pretraining."""
    return pretrained(cfg, tmp_path_factory.mktemp("whole"))


@pytest.fixture
def steps(monkeypatch):
    """The epoch of every training step."""
    epochs, step = [], ImagePretraining.training_step

    def watched(self, batch, index):
        epochs.append(self.current_epoch)
        return step(self, batch, index)

    monkeypatch.setattr(ImagePretraining, "training_step", watched)
    return epochs


def data_with(cfg, test_clip="suburb/clip00"):
    cfg = cfg.copy()
    cfg.data.test_clips = [test_clip]
    return Session(cfg).data


def test_the_file_is_named_after_its_content_and_a_run_begins_with_it(weights, cfg):
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    assert weights.name == f"image_encoder-{digest[:8]}.pth"
    trained, _ = read_encoder(weights)
    fresh = ResNet(cfg.size.backbone_depth, cfg.size.backbone_width)
    assert fresh.state_dict().keys() == trained.keys()
    cfg = cfg.copy()
    cfg.model.backbone.weights = str(weights)
    begins = untrained(cfg, data_with(cfg)).network.backbone.state_dict()
    assert all(begins[name].equal(value) for name, value in trained.items())


def test_it_goes_on_where_it_was_interrupted(weights, cfg, tmp_path, monkeypatch, steps):
    step = ImagePretraining.training_step

    def stopping(self, batch, index):
        if self.current_epoch == 1 and index == 1:
            raise Stop
        return step(self, batch, index)

    with monkeypatch.context() as patched:
        patched.setattr(ImagePretraining, "training_step", stopping)
        with pytest.raises(Stop):
            pretrained(cfg, tmp_path)
    assert not list(tmp_path.rglob("*.pth"))
    steps.clear()
    again = pretrained(cfg, tmp_path)
    assert set(steps) == {1}
    assert again.name == weights.name
    assert again.read_bytes() == weights.read_bytes()


def test_an_epoch_may_be_shortened_and_a_broken_checkpoint_is_one_line(cfg, tmp_path, steps):
    pretrained(cfg, tmp_path, limit_train_batches=1)
    assert steps == [0, 1]
    (checkpoint,) = tmp_path.rglob("last.ckpt")
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(UserError, match=r"last\.ckpt"):
        pretrained(cfg, tmp_path, limit_train_batches=1)


def test_the_file_does_not_depend_on_the_process_that_writes_it(cfg, tmp_path, monkeypatch):
    """A sweep that is given a file of another name begins anew."""
    backbone, names, data = torch.nn.Linear(2, 2), set(), data_with(cfg)
    for process in (11, 22):
        monkeypatch.setattr(os, "getpid", lambda process=process: process)
        names.add(write_encoder(tmp_path, backbone, data).name)
    assert len(names) == 1


def test_an_encoder_that_has_learnt_a_clip_is_not_tested_on_it(weights, cfg, tmp_path):
    others = data_with(cfg, "downtown/clip00")
    require_unseen(str(weights), data_with(cfg))
    with pytest.raises(UserError, match=r"\.pth .*downtown/clip00"):
        require_unseen(str(weights), others)
    # Nor does a run begin that would be.
    other = cfg.copy()
    other.model.backbone.weights, other.data.test_clips = str(weights), ["downtown/clip00"]
    with pytest.raises(UserError, match="downtown/clip00"):
        fit(other)
    assert not Path(cfg.paths.run).exists()
    state, origin = read_encoder(weights)
    # Flights of another dataset are others, whatever their names.
    elsewhere = {"state_dict": state, ORIGIN: {**origin, "dataset": "tiny-0123"}}
    torch.save(elsewhere, tmp_path / weights.name)
    # Nothing is known of what others have published.
    torch.save(state, tmp_path / "resnet18.pth")
    for known in (None, "imagenet", tmp_path / weights.name, tmp_path / "resnet18.pth"):
        require_unseen(known and str(known), others)


def test_a_file_that_does_not_say_what_it_has_seen_or_cannot_be_read_is_named(
    weights, cfg, tmp_path
):
    ours, broken = tmp_path / "image_encoder.pth", tmp_path / "some.pth"
    torch.save(read_encoder(weights)[0], ours)
    broken.write_text("{}")
    for path in (ours, broken):
        with pytest.raises(UserError, match=path.name):
            require_unseen(str(path), data_with(cfg))


def test_without_a_dataset_or_for_another_backbone_nothing_is_made(cfg, tmp_path):
    chosen = ["model/backbone=huggingface", "model.backbone.pretrained=false"]
    other = compose_config("scale=tiny", *chosen)
    other.paths = cfg.paths
    with pytest.raises(UserError, match=r"^model/backbone: .* resnet"):
        pretrained(other, tmp_path)
    other = cfg.copy()
    other.paths.data = str(tmp_path / "data")
    with pytest.raises(UserError, match=r"manifest\.json: not found"):
        pretrained(other, tmp_path)
    assert not list(tmp_path.iterdir())


def test_another_schedule_leaves_the_file_where_it_is(weights, cfg):
    place = weights.parents[1]
    pretrain(cfg, str(place), **{**SETTINGS, "epochs": 1})
    assert weights.is_file()
    assert len(list(place.glob("tiny-*/*.pth"))) == 2


def test_no_frame_of_the_test_split_is_read(cfg, tmp_path, monkeypatch):
    read, sample = [], OccupancyDataset._sample

    def watched(self, clip, now, past):
        read.append((clip, now))
        return sample(self, clip, now, past)

    monkeypatch.setattr(OccupancyDataset, "_sample", watched)
    pretrained(cfg, tmp_path)
    split = data_with(cfg).split
    assert set(read) == {*split["train"], *split["val"]}


def test_a_report_does_not_take_it_for_a_run():
    """A report takes every folder with a configuration that lies below its scale's runs."""
    cfg = compose_config("task=pretrain", "scale=tiny", "paths.runs=here/runs")
    assert Path("here/runs") not in Path(cfg.task.out).parents
