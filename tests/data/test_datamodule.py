"""The dataset as the trainer sees it."""

import pytest
import torch

from src.data.datamodule import SkyShieldData
from src.errors import UserError
from tests.data.conftest import assert_same
from tests.synthetic import compose_config, mini_overrides, write_dataset

OPTIONS = {
    **{"val_clips": [], "test_clips": ["suburb/clip00"], "frames": 4, "history_step_s": 0.4},
    **{"history": "open", "order": "shuffled", "run_frames": 10, "mirror": True},
    **{"batch_size": 8, "workers": 0, "seed": 0},
}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_dataset(compose_config(*mini_overrides(tmp_path_factory.mktemp("data"))))


def data_of(root, **options):
    return SkyShieldData(root, **{**OPTIONS, **options})


def test_every_part_has_its_frames(root):
    """At 2.5 Hz a clip has 30 frames: 25 for training, 3 for validation and 2 for test."""
    data = data_of(root)
    sizes = {part: len(data.dataset(part)) for part in data.split}
    assert sizes == {"train": 25, "val": 3, "test": 32}
    assert {clip for clip, _ in data.split["train"]} == {"downtown/clip00"}


def test_batches_do_not_depend_on_the_number_of_workers(root):
    alone, helped = (list(data_of(root, workers=n).train_dataloader()) for n in (0, 2))
    assert len(alone) == len(helped) == 3
    for batch, other in zip(alone, helped):
        assert_same(batch, other)


def test_images_stay_bytes_and_a_short_batch_is_kept_where_it_is_all(root):
    (batch,) = data_of(root, batch_size=64).train_dataloader()
    assert batch["image"].dtype == torch.uint8
    assert batch["image"].shape == (25, 4, 3, 64, 96)


def test_streams_read_the_current_image_alone_and_reach_back_as_far_as_they_went(root):
    loader = data_of(root, order="streams", batch_size=5, run_frames=5).train_dataloader()
    batches = list(loader)
    assert [tuple(b["image"].shape) for b in batches] == [(5, 1, 3, 64, 96)] * 5
    for step, batch in enumerate(batches):
        for place in range(5):
            reach = int(batch["history_valid"][place].sum()) - 1
            assert reach == min(step, 3), "runs of five, five of them, fill the places exactly"
            for age in range(1, reach + 1):
                assert batches[step - age]["frame"][place] == batch["frame"][place] - age


def test_validation_and_test_are_whole_in_order_and_not_mirrored(root):
    data = data_of(root)
    for part, loader in (("val", data.val_dataloader()), ("test", data.test_dataloader())):
        seen = [pair for b in loader for pair in zip(b["clip"], b["frame"].tolist())]
        assert seen == data.split[part]
    batch = next(iter(data.test_dataloader()))
    assert torch.equal(batch["image"][0], data.dataset("test")[0]["image"])


def test_labels_are_those_of_the_samples(root):
    data = data_of(root)
    samples = data.dataset("val")
    for index, (semantics, velocity_mps, layer) in enumerate(data.labels("val")):
        assert torch.equal(semantics, samples[index]["semantics"])
        assert abs(layer * data.grid.voxel_m - samples[index]["height_m"]) <= data.grid.voxel_m / 2
        assert velocity_mps.norm() == pytest.approx(samples[index]["velocity_mps"].norm().item())


def test_what_cannot_be_loaded_is_refused_by_its_key_or_file_even_from_a_worker(root, tmp_path):
    lopsided = ("grid.lower_m=[0.0,-20.0,-20.0]", "grid.upper_m=[50.0,30.0,10.0]")
    other = write_dataset(compose_config(*mini_overrides(tmp_path, *lopsided)))
    for folder, options, message in (
        (root, {"order": "sorted"}, r"data\.order: 'sorted'.*shuffled, streams"),
        (root, {"val_clips": ["downtown/clip00"]}, r"data\.val_clips.*train"),
        (other, {}, r"set data\.mirror=false"),
    ):
        with pytest.raises(UserError, match=message):
            data_of(folder, **options)
    assert len(data_of(other, mirror=False).dataset("train")) == 25

    path = other / "downtown/clip00/rgb.zip"
    path.write_bytes(path.read_bytes()[:3000])
    for workers in (0, 1):
        with pytest.raises(UserError, match=r"rgb\.zip"):
            list(data_of(other, mirror=False, workers=workers).train_dataloader())
