"""A sight of the true surfaces: what it tells is there, and how a wrong depth or attitude lies."""

import shutil

import pytest
import torch
from torch.utils.data import default_collate

from src.data.clip import AUX, Clip
from src.data.dataset import OccupancyDataset
from src.errors import UserError
from src.geometry import VoxelGrid, transform, world_from_occ
from src.ontology import CAR, CLASSES, FREE
from studies.bounds.true_sight import TrueSight, counted, smooth_field
from tests.synthetic import BOXES


@pytest.fixture
def clip(clips):
    return clips["downtown/clip00"]


@pytest.fixture
def sight(clip):
    def of(**settings):
        return TrueSight({clip.clip_id: clip}, 2, **settings)

    return of


def batch_of(clip, *frames):
    samples = [(clip.clip_id, frame) for frame in frames]
    dataset = OccupancyDataset({clip.clip_id: clip}, samples, 4, 0.4)
    return default_collate([dataset[n] for n in range(len(frames))])


def right(labels, batch, clip):
    """Of the voxels that are told to be occupied, the share through which a surface of that class
    goes: it is no further from the center than a corner."""
    grid, distances = clip.meta.grid, []
    reach_m = grid.voxel_m * 3**0.5 / 2 + 1e-6
    for told, frame in zip(labels, batch["frame"]):
        centers = grid.centers(torch.float64)[told < FREE]
        points = transform(world_from_occ(clip.world_from_body[frame]), centers)
        from_class = {CLASSES.index("ground"): points[:, 2].abs()}
        for lower, upper, name, _ in BOXES:
            nearest = points.clamp(points.new_tensor(lower), points.new_tensor(upper))
            from_class[CLASSES.index(name)] = (points - nearest).norm(dim=1)
        own = torch.full((len(points),), torch.inf, dtype=torch.float64)
        for class_id, distance_m in from_class.items():
            own = torch.where(told[told < FREE] == class_id, distance_m, own)
        distances.append(own)
    return (torch.cat(distances) <= reach_m).double().mean()


def test_what_it_sees_is_there_and_what_it_does_not_see_it_calls_free(sight, clip):
    batch = batch_of(clip, 5, 20)
    labels = sight()(batch)
    assert labels.dtype == torch.uint8
    assert ((labels < FREE).sum(dim=(1, 2, 3)) > 20).all()
    assert right(labels, batch, clip) == 1
    assert (labels == FREE).double().mean() > 0.5


def test_a_wrong_depth_or_attitude_tells_what_is_not_there(sight, clip):
    batch = batch_of(clip, 5, 12, 20)
    for by in ("image", "pixel"):
        assert right(sight(depth_error=0.3, by=by)(batch), batch, clip) < 0.9
    level = {**batch, "occ_from_body": torch.eye(4).expand_as(batch["occ_from_body"])}
    assert right(sight()(level), batch, clip) < 0.9


def test_a_history_sees_all_that_the_current_frame_sees_and_more(sight, clip):
    batch = batch_of(clip, 0, 20)
    one, queue = sight()(batch) < FREE, sight(frames=4)(batch) < FREE
    assert torch.equal(one[0], queue[0]), "the first frame has no history"
    assert (one & ~queue).sum() == 0
    assert queue[1].sum() > one[1].sum()
    assert right(sight(frames=4)(batch), batch, clip) == 1


def test_the_error_is_as_large_as_asked_and_the_same_whatever_came_before(sight, clip):
    for by in ("image", "pixel"):
        noisy = sight(depth_error=0.05, by=by, seed=3)
        error = noisy._error(clip, 7)
        assert error.abs().mean() == pytest.approx(0.05)
        noisy(batch_of(clip, 2))
        assert torch.equal(noisy._error(clip, 7), error)
        assert not torch.equal(noisy._error(clip, 8), error)
        assert not torch.equal(sight(depth_error=0.05, by=by, seed=4)._error(clip, 7), error)


def test_a_smooth_field_hardly_changes_from_pixel_to_pixel():
    field = smooth_field(64, 96, torch.Generator().manual_seed(0))
    assert field.diff(dim=1).abs().max() < 0.25 * field.std()
    assert field.std() > 0.1


def test_points_are_counted_in_their_voxels():
    grid = VoxelGrid((0, 0, 0), (2, 2, 2), (2, 2, 2))
    points = torch.tensor([[0.5, 0.5, 1.5], [0.7, 0.1, 1.1], [1.5, 0.5, 0.5], [2.5, 0.5, 0.5]])
    votes = counted(points, torch.tensor([CAR, CAR, 0, CAR], dtype=torch.uint8), grid)
    assert votes.sum() == 3
    assert (votes[CAR, 0, 0, 1], votes[0, 1, 0, 0]) == (2, 1)


def test_what_cannot_be_is_refused(sight, clip, tmp_path):
    with pytest.raises(UserError, match=r"^task\.by: 'row'"):
        sight(by="row")
    for wrong in (-0.1, float("nan")):
        with pytest.raises(UserError, match=r"^task\.depth_error: "):
            sight(depth_error=wrong)
    bare = shutil.copytree(clip.folder, tmp_path / "town/clip00")
    (bare / AUX).unlink()
    with pytest.raises(UserError, match=r"town/clip00: .*sim\.save_aux=true"):
        TrueSight({"town/clip00": Clip(bare)}, 1)
