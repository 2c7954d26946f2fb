"""Formats of labels: what is written of a frame is read again, also where bits fill no byte."""

import numpy as np
import pytest

from src.errors import UserError
from src.formats import WRITTEN_FORMATS
from src.geometry import VoxelGrid

SHAPE = (5, 4, 3)  # 60 voxels: seven bytes and a half
GRID = VoxelGrid((0, 0, 0), SHAPE, SHAPE)


@pytest.mark.parametrize("kind", WRITTEN_FORMATS)
def test_ids_and_masks_come_back(tmp_path, kind):
    of, rng = WRITTEN_FORMATS[kind], np.random.default_rng(0)
    ids = rng.choice(list(of.ids.values()), SHAPE)
    known, seen = rng.random(SHAPE) < 0.7, rng.random(SHAPE) < 0.5
    for predicted in (False, True):
        path = tmp_path / str(predicted) / of.place("town/clip", "000007", predicted)
        path.parent.mkdir(parents=True)
        of.write(path, ids, known, seen)
        assert of.find(tmp_path / str(predicted), predicted) == {("town/clip", "000007"): path}
        assert (of.read(path, GRID) == ids).all()
        everything, visible = [*of.masks][::-1] if kind == "occ3d" else of.masks
        assert (of.read_mask(path, everything, SHAPE) == known).all()
        assert (of.read_mask(path, visible, SHAPE) == (known & seen)).all()


@pytest.mark.parametrize("kind", ["semantickitti", "occufly"])
def test_labels_of_points_and_predictions_beside_the_truth_are_left_alone(tmp_path, kind):
    """SemanticKITTI keeps labels of its point clouds, too, in files of the same name."""
    of = WRITTEN_FORMATS[kind]
    for name in (of.place("a", "000001", False), of.place("a", "000002", True), "a/labels/1.label"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    assert list(of.find(tmp_path, False)) == [("a", "000001")]
    assert list(of.find(tmp_path, True)) == [("a", "000002")]


def test_a_missing_mask_is_named(tmp_path):
    path = tmp_path / "000001.label"
    with pytest.raises(UserError, match=r"000001\.invalid: cannot be read \(No such file"):
        WRITTEN_FORMATS["semantickitti"].read_mask(path, "valid", SHAPE)
