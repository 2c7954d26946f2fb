"""Folders of predictions: written whole, and every missing, extra or corrupt frame is named."""

import errno
from pathlib import Path

import numpy as np
import pytest
import torch

from src.data.predictions import FACTS, PredictedFrame, Predictions, save_predictions
from src.errors import UserError

SHAPE = (4, 3, 2)
SAMPLES = [("town/clip00", 3), ("town/clip00", 4), ("town/clip01", 0)]
CORRUPT = {
    "shape": np.zeros((4, 3, 3), np.uint8),
    "floats": np.full(SHAPE, 0.5, np.float32),
    "class 9": np.full(SHAPE, 9, np.uint8),
    "negative": np.full(SHAPE, -1, np.int64),
    "pickle": np.array([{}], dtype=object),
}


def labels_at(frame):
    return torch.full(SHAPE, frame % 9, dtype=torch.uint8)


@pytest.fixture
def folder(tmp_path):
    frames = []
    for clip, frame in SAMPLES:
        logits = torch.nn.functional.one_hot(labels_at(frame).long(), 9).movedim(-1, 0)
        sure = {"logits": 3.0 * logits, "knowledge": labels_at(frame).numpy() % 3}
        frames.append(PredictedFrame(clip, frame, labels_at(frame), **sure))
    save_predictions(tmp_path / "run" / "test", {"name": "mine"}, frames)
    return tmp_path / "run" / "test"


def rewrite(folder, clip="town/clip00", **changes):
    path = folder / clip / "occupancy.npz"
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files} | changes
    np.savez_compressed(path, **{k: v for k, v in arrays.items() if v is not None})


def test_a_folder_that_is_there_is_not_to_be_deleted(tmp_path):
    with pytest.raises(UserError, match="exists already; move it away, or choose another"):
        save_predictions(tmp_path, {}, [])


def test_facts_that_the_system_does_not_let_be_read_are_not_taken_for_none(tmp_path, monkeypatch):
    assert Predictions(tmp_path).facts == {}
    (tmp_path / FACTS).write_text("no JSON")
    assert Predictions(tmp_path).facts == {}

    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refuse)
    with pytest.raises(
        UserError, match=r"predictions\.json: cannot be read .*; ask for the permission"
    ):
        _ = Predictions(tmp_path).facts


def test_what_was_written_is_read(folder):
    predictions = Predictions(folder)
    assert predictions.facts == {"name": "mine"}
    assert predictions.inventory(SAMPLES, SHAPE).sound
    for clip, frame in SAMPLES:
        assert torch.equal(predictions.labels(clip, frame), labels_at(frame))
        assert torch.equal(predictions.logits(clip, frame).argmax(0), labels_at(frame).long())
        with np.load(folder / clip / "knowledge.npz") as known:
            assert (known[f"knowledge_{frame:06d}"] == labels_at(frame).numpy() % 3).all()
    (folder / "town/clip01/logits.npz").unlink()
    assert predictions.logits("town/clip01", 0) is None


def test_a_folder_is_not_written_to_where_there_is_one_nor_read_where_there_is_none(folder):
    with pytest.raises(UserError, match=str(folder)):
        save_predictions(folder, {}, [])
    with pytest.raises(UserError, match=r"^predictions: .*task=predict"):
        Predictions(folder / "none")


def test_after_a_failure_nothing_is_left(tmp_path):
    def frames():
        yield PredictedFrame("town/clip00", 0, labels_at(0))
        raise RuntimeError("of the model")

    with pytest.raises(RuntimeError):
        save_predictions(tmp_path / "new", {}, frames())
    assert list(tmp_path.iterdir()) == []


def test_missing_and_extra_frames_are_named_and_counted(folder):
    rewrite(folder, semantics_000003=None, semantics_000007=labels_at(7).numpy())
    inventory = Predictions(folder).inventory(SAMPLES, SHAPE)
    assert inventory.missing == ["town/clip00 semantics_000003"]
    assert inventory.extra == ["town/clip00 semantics_000007"]
    assert str(inventory).startswith("1 missing: town/clip00 semantics_000003; 1 extra: ")

    # More than three are counted, and not all named.
    samples = [("town/clip09", frame) for frame in range(5)]
    message = str(Predictions(folder).inventory(samples, SHAPE))
    assert message.startswith("5 missing: ")
    assert message.count("town/clip09") == 3
    assert "..." in message


@pytest.mark.parametrize("kind", CORRUPT)
def test_a_frame_that_cannot_be_scored_is_corrupt(folder, kind):
    rewrite(folder, semantics_000003=CORRUPT[kind])
    predictions = Predictions(folder)
    inventory = predictions.inventory(SAMPLES, SHAPE)
    (problem,) = inventory.corrupt
    assert problem.startswith(f"{folder}/town/clip00/occupancy.npz: semantics_000003 ")
    assert not inventory.missing
    assert predictions.problem_of("town/clip00", 3, SHAPE) == problem
    assert predictions.problem_of("town/clip00", 4, SHAPE) == ""


@pytest.mark.parametrize("size", [0, 100, -30])
def test_a_file_that_is_cut_off_is_corrupt(folder, size):
    path = folder / "town/clip00/occupancy.npz"
    path.write_bytes(path.read_bytes()[:size])
    inventory = Predictions(folder).inventory(SAMPLES, SHAPE)
    (problem,) = inventory.corrupt
    assert problem.startswith(f"{path}: cannot be read")
    assert Predictions(folder).problem_of("town/clip00", 3, SHAPE)


def test_a_flipped_byte_is_found(folder):
    path = folder / "town/clip00/occupancy.npz"
    content = bytearray(path.read_bytes())
    with np.load(path) as archive:
        offset = archive.zip.getinfo("semantics_000003.npy").header_offset
    content[offset + 90] ^= 0xFF
    path.write_bytes(bytes(content))
    assert "town/clip00" in str(Predictions(folder).inventory(SAMPLES, SHAPE))
