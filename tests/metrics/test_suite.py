"""All metrics together, by clip."""

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.metrics import KARMeanIoU, OccupancyScores
from src.metrics.suite import ScoreSuite

CLIPS = ["town/clip00", "town/clip01", "town/clip02"]
METRIC = {
    **{"_target_": "of Hydra", "num_classes": 9, "free_index": 8, "ignore_index": 255},
    **{"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0},
}
SUITE = {
    **{"ttc_edges_s": [1.0, 5.0], "distance_edges_m": [5.0, 10.0]},
    **{"tube_radius_m": 3.0, "tube_s": 2.0, "thin_tolerance": 1, "calibration_bins": 5},
    **{"ray_thresholds_m": [1.0, 4.0], "rays": [6, 4], "sensitivity": {"horizon_s": [2.5, 5.0]}},
    **{"resamples": 50, "level": 0.9, "seed": 0},
}


def truth_of(target, velocity, clips):
    level = torch.tensor([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    lens = torch.tensor([[32.0, 0, 32], [0, 32, 16], [0, 0, 1]])
    return {
        "clip": clips,
        "semantics": target,
        "velocity_mps": velocity,
        "visible": target < 4,
        "camera_from_occ": level.expand(len(target), 4, 4),
        "pix_from_camera": lens.expand(len(target), 3, 3),
        "size_pix": (64, 32),
    }


@pytest.fixture
def scored(grid, random_batch):
    suite = ScoreSuite(grid, CLIPS, METRIC, SUITE)
    for seed, clip in enumerate(CLIPS[:2]):
        preds, target, velocity = random_batch(seed)
        logits = torch.nn.functional.one_hot(preds.long(), 9).movedim(-1, 1).float()
        suite.update(logits, truth_of(target, velocity, [clip] * len(target)))
    return suite


def test_every_metric_has_counted(scored):
    names = ["occupancy", "breakdown", "safety", "rays", "calibration", "sensitivity"]
    assert list(scored.tables()) == names
    assert all(not t[2].any() for tables in scored.tables().values() for t in tables.values())


def test_scores_of_a_clip_are_those_of_its_frames(scored, grid, random_batch):
    alone = OccupancyScores(grid)
    alone.update(*random_batch(1))
    expected = {name: float(value) for name, value in alone.compute().items()}
    found = scored.scores(lambda clip: clip == CLIPS[1])
    assert {name: found[name] for name in expected} == expected
    assert found["all/kar_miou"] == expected["kar_miou"]


def test_names_of_scores_do_not_collide(scored):
    names = [
        name for metric in scored.by_clip.values() for name in metric.metric.scores(metric.tables())
    ]
    assert len(names) == len(set(names))


def test_labels_without_logits_or_cameras_leave_these_scores_out(grid, random_batch):
    suite = ScoreSuite(grid, CLIPS, METRIC, SUITE)
    preds, target, velocity = random_batch(0)
    truth = truth_of(target, velocity, CLIPS[:1] * 4)
    suite.update(preds, {key: truth[key] for key in ("clip", "semantics", "velocity_mps")})
    assert list(suite.tables()) == ["occupancy", "breakdown", "safety", "sensitivity"]
    assert "nll" not in suite.scores()


def test_logits_beside_labels_serve_the_calibration_alone(grid, random_batch):
    suite = ScoreSuite(grid, CLIPS, METRIC, SUITE)
    preds, target, velocity = random_batch(0)
    logits = torch.zeros(4, 9, *grid.shape)
    suite.update(preds, truth_of(target, velocity, CLIPS[:1] * 4), logits)
    alone = KARMeanIoU(grid)
    alone.update(preds, target, velocity)
    assert suite.scores()["kar_miou"] == float(alone.compute())
    assert suite.scores()["nll"] == pytest.approx(np.log(9), abs=1e-5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("level", level) for level in (0, 1, 95)),
        *(("rays", rays) for rays in ([6], [6, 4, 2], [6, 0], [6.5, 4])),
        ("resamples", 0),
    ],
)
def test_settings_that_would_fail_after_the_counting_are_refused_before(grid, key, value):
    with pytest.raises(UserError, match=rf"^suite\.{key}: "):
        ScoreSuite(grid, CLIPS, METRIC, SUITE | {key: value})


def test_a_data_set_without_a_label_scores_nan_and_no_error(grid, random_batch):
    suite = ScoreSuite(grid, CLIPS, METRIC, SUITE)
    preds, target, velocity = random_batch(0)
    unknown = torch.full_like(target, 255)
    suite.update(preds, truth_of(unknown, velocity, CLIPS[:1] * 4))
    assert np.isnan(suite.scores()["kar_miou"])
    assert "occupancy" in suite.tables()
