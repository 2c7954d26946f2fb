"""TartanGround's occupancy: points lie where they were cut."""

import json

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.formats import LABEL_FORMATS, WRITTEN_FORMATS
from src.geometry import VoxelGrid
from src.recordings.classes import class_map_of
from src.results.files import read_results
from src.tasks.score import score
from tests.synthetic import compose_config

GRID = VoxelGrid((-2, -2, -1), (2, 2, 3), (8, 8, 8))
OF = LABEL_FORMATS["tartanground"]


def cut(cloud, bounds_m, resolution_m):
    """What `subsample_semantic_pcd_gpu.py` makes of points and their ids, forward, right, down."""
    points = np.array([each[:3] for each in cloud], dtype=np.float32)
    lower, upper = np.array(bounds_m[::2]), np.array(bounds_m[1::2])
    sizes = ((upper - lower) / resolution_m).astype(int) + 1
    ids = np.zeros(sizes, dtype=np.int32)
    at = np.clip(np.floor((points - lower) / resolution_m).astype(int), 0, sizes - 1)
    ids[tuple(at.T)] = [each[3] for each in cloud]
    return ids


def write(folder, cloud, token="000003", bounds_m=(-2, 2, -2, 2, -3, 1), resolution_m=0.5, **other):
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {"occupancy_map": cut(cloud, bounds_m, resolution_m), "bounds": np.array(bounds_m)}
    # They keep their colors as a pickled object, which is never read.
    arrays |= {"resolution": resolution_m, "class_mapping": {0: (1, 2, 3)}}
    path = folder / f"semantic_occupancy_{token}.npz"
    np.savez_compressed(path, **arrays | other)
    return path


# Forward, right, down, and the id: ahead to the left and above; behind to the right and below.
CLOUD = [(1.7, -1.2, -2.9, 7), (-1.9, 1.9, 0.8, 9)]


def test_points_lie_where_they_are(tmp_path):
    ids = OF.read(write(tmp_path, CLOUD), GRID)
    places = torch.tensor([[1.7, 1.2, 2.9], [-1.9, -1.9, -0.8]])
    index, inside = GRID.index_of(places)
    assert inside.all()
    assert ids[tuple(index.T.numpy())].tolist() == [7, 9]
    assert (ids != 0).sum() == 2


def test_files_are_found_by_trajectory_and_pose_and_are_not_written(tmp_path):
    path = write(tmp_path / "Data_omni" / "P0001" / "sem_occ", CLOUD)
    assert OF.find(tmp_path, False) == {("Data_omni/P0001/sem_occ", "000003"): path}
    assert "tartanground" not in WRITTEN_FORMATS


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"resolution_m": 0.25}, r"\[17, 17, 17\].*layout\.grid\.shape is \[8, 8, 8\]"),
        # As many voxels, of a grid that is turned over.
        ({"bounds_m": (-2, 2, -2, 2, -1, 3)}, r"bounds are \[-2, 2, -2, 2, -1, 3\].*layout\.grid"),
        ({"occupancy_map": np.full((9, 9, 9), 0.5)}, "no class ids"),
        ({"occupancy_map": np.array({})}, "cannot be read"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, words, message):
    path = write(tmp_path, CLOUD, **words)
    with pytest.raises(UserError, match=rf"^{path}: .*{message}"):
        OF.read(path, GRID)


@pytest.fixture
def environment(tmp_path):
    names = {"SM_Car_01": 7, "GroundTile": 9, "SM_Sofa": 4, "Skysphere": 5, "nothing": 0}
    folder = tmp_path / "Town"
    write(folder / "Data_omni" / "P0001" / "sem_occ", CLOUD)
    (folder / "seg_label_map.json").write_text(json.dumps({"name_map": names}))
    return folder


def test_an_environment_is_scored_by_the_names_of_its_classes(environment, tmp_path, capsys):
    write(tmp_path / "mine" / "Data_omni" / "P0001" / "sem_occ", CLOUD[:1])
    grid = "layout.grid={lower_m:[-2,-2,-1],upper_m:[2,2,3],shape:[8,8,8]}"
    words = ["layout=tartanground", grid, "layout.velocity_mps=[1,0,0]", f"dataset={environment}"]
    cfg = compose_config("task=score", *words, f"predictions={tmp_path / 'mine'}")
    score(cfg, "test", False, str(tmp_path / "scores"))
    row = read_results(tmp_path / "scores" / "results.csv").iloc[0]
    assert (row["iou/car"], row["iou/ground"]) == (1, 0)
    assert "classes that are general here: SM_Sofa\n" in capsys.readouterr().out


def test_an_environment_without_names_is_refused(environment):
    (environment / "seg_label_map.json").unlink()
    words = ["layout=tartanground", "layout.velocity_mps=[1,0,0]", f"dataset={environment}"]
    cfg = compose_config("task=score", *words, f"predictions={environment}")
    with pytest.raises(UserError, match=r"no seg_label_map\.json"):
        score(cfg, "test", False, None)


def test_the_words_give_our_class_of_every_id(environment):
    names, general = class_map_of(
        environment, {"car": ["car"], "ground": ["ground"], "sky": ["skysphere"]}
    )
    assert general == ["SM_Sofa"]
    assert names == {7: "car", 9: "ground", 4: "general", 5: "unknown", 0: "free"}
