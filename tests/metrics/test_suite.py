"""All metrics together, by clip: those of the configuration, and one of somebody's own."""

import sys

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from src.errors import UserError
from src.metrics import KARBreakdown, KARMeanIoU, OccupancyScores
from src.metrics.protocol import SUPERVISED, Protocol
from src.metrics.suite import ScoreSuite, import_metrics
from src.results.counts import Counts
from src.results.files import run_table
from src.results.table import Resamples
from tests.metrics.inputs import CLIPS, METRIC, SUITE, scores_of, truth_of, updated
from tests.synthetic import compose_config, sound_config


def protocol_of(grid, settings):
    return Protocol.of("mini-0", "test", 4, grid, SUPERVISED, METRIC, settings)


@pytest.fixture
def batch(random_batch):
    """Labels and the ground truth of four frames of the first clip."""
    preds, target, velocity = random_batch(0)
    return preds, truth_of(target, velocity, CLIPS[:1] * 4)


def test_every_metric_has_counted_and_scores_of_a_clip_are_those_of_its_frames(
    scored, grid, random_batch
):
    assert list(scored.counts()) == list(SUITE["metrics"])
    for counts in scored.counts().values():
        assert any(each.any() for each in counts.values())
        assert not any(each[2].any() for each in counts.values())

    expected = scores_of(OccupancyScores(grid), random_batch(1))
    scores = scored.scores(lambda clip: clip == CLIPS[1])
    assert {name: scores[name] for name in expected} == expected
    assert scores["all/kar_miou"] == expected["kar_miou"]


def test_a_metric_that_says_so_stays_out_of_the_table_of_scores(scored, grid, monkeypatch):
    monkeypatch.setattr(KARBreakdown, "in_score_table", False)
    listed = scored.scores()
    for name, by_clip in scored.by_clip.items():
        scores = by_clip.scores(by_clip.counts)
        assert (scores.keys() <= listed.keys()) == (name != "breakdown")
    counts = Counts("mine", protocol_of(grid, SUITE), CLIPS, [4, 4, 0], scored.counts())
    table = run_table({0: [counts]}, {"test": lambda clip: True})
    assert list(table["score"]) == list(listed)


def test_a_metric_is_fed_where_the_batch_has_what_it_needs_and_forgotten_if_only_partly(
    batch, grid, random_batch
):
    suite, (preds, truth) = ScoreSuite(grid, CLIPS, SUITE), batch
    suite.update(*batch, torch.zeros(4, 9, *grid.shape))
    assert suite.forget_partly_fed() == []
    alone = updated(KARMeanIoU(grid), random_batch(0)).compute()
    assert suite.scores()["kar_miou"] == float(alone)
    assert suite.scores()["nll"] == pytest.approx(np.log(9), abs=1e-5)

    suite.update(preds, {key: truth[key] for key in ("clip", "semantics", "velocity_mps")})
    assert suite.forget_partly_fed() == ["rays", "calibration", "occupied"]
    assert suite.counts().keys() == SUITE["metrics"].keys() - {"rays", "calibration", "occupied"}
    assert "nll" not in suite.scores()


# ---------------------------------------------------------------------------- its configuration


def with_entry(name, **entry):
    return SUITE | {"metrics": SUITE["metrics"] | {name: entry}}


CALIBRATION = "src.metrics.Calibration"
RAYS = SUITE["metrics"]["rays"]


BAD_SETTINGS = [
    *(("suite.level: ", SUITE | {"level": level}) for level in (0, 95)),
    ("suite.resamples: 0", SUITE | {"resamples": 0}),
    *(
        ("rays: .*suite.metrics.rays", with_entry("rays", **RAYS | {"rays": rays}))
        for rays in ([6], [6, 0], [6.5, 4])
    ),
    ("bins: 0 .*suite.metrics.mine", with_entry("mine", _target_=CALIBRATION, bins=0)),
    (".*`bin` .suite.metrics.mine", with_entry("mine", _target_=CALIBRATION, bin=3)),
    ("suite.metrics.mine: ece .*calibration", with_entry("mine", _target_=CALIBRATION)),
    ("suite.metrics.mine: .*origin_m", with_entry("mine", _target_="src.metrics.RayIoU")),
    *(
        (f"suite.metrics.mine._target_: {target}", with_entry("mine", _target_=target))
        for target in ("src.metrics.Nothing", "torch.nn.Linear", "nowhere.Mine")
    ),
]


@pytest.mark.parametrize(("message", "settings"), BAD_SETTINGS)
@pytest.mark.usefixtures("unchecked")
def test_settings_that_would_fail_after_the_counting_are_refused_before(grid, message, settings):
    with pytest.raises(UserError, match=rf"^{message}"):
        ScoreSuite(grid, CLIPS, settings)


def test_shared_settings_reach_every_metric_that_has_them(grid):
    cfg = compose_config("metric.horizon_s=3.5", "suite.calibration_bins=7", "suite.rays=[5,3]")
    suite = ScoreSuite(grid, CLIPS, OmegaConf.to_container(cfg.suite, resolve=True))
    for name in ("occupancy", "breakdown", "safety"):
        assert suite.metric(name).penalty.horizon_s == 3.5
    calibration = suite.metric("calibration")
    assert (calibration.bubble.horizon_s, calibration.bins) == (3.5, 7)
    assert suite.metric("rays").rays == (5, 3)


def test_counts_of_before_the_metrics_were_named_are_one_clear_error(grid):
    settings = {key: value for key, value in SUITE.items() if key != "metrics"}
    with pytest.raises(UserError, match=r"^suite\.metrics: "):
        ScoreSuite.of(protocol_of(grid, settings), CLIPS)


# ------------------------------------------------------------------------- a metric of one's own

CLASS = '''
import torch

from src.metrics import CountMetric


class FreeShare(CountMetric):
    """The share of the voxels of a mask that are predicted free."""

    def __init__(self, grid, free=8):
        super().__init__({"voxels": (2,)})
        self.free = free

    def frame_counts(self, preds, visible):
        free = visible & (preds == self.free)
        return {"voxels": torch.stack([free.sum((1, 2, 3)), visible.sum((1, 2, 3))], dim=1)}

    def scores(self, counts):
        return {"free_share": counts["voxels"][..., 0] / counts["voxels"][..., 1]}
'''
ENTRY = "defaults: [default, _self_]\nmetrics:\n  mine: { _target_: my_metrics.FreeShare }\n"


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The settings of a suite with a metric that is one file and three lines of configuration."""
    (tmp_path / "my_metrics.py").write_text(CLASS)
    (tmp_path / "suite").mkdir()
    (tmp_path / "suite/mine.yaml").write_text(ENTRY)
    monkeypatch.syspath_prepend(tmp_path)
    cfg = sound_config("suite=mine", folder=tmp_path)
    yield OmegaConf.to_container(cfg.suite, resolve=True) | {"rays": [6, 4]}
    sys.modules.pop("my_metrics", None)


def test_ones_own_metric_is_counted_saved_resampled_and_scored(own, grid, batch, tmp_path):
    import_metrics(own)
    suite, (preds, truth) = ScoreSuite(grid, CLIPS, own), batch
    suite.update(preds, truth)
    free = float((preds[truth["visible"]] == 8).double().mean())
    assert suite.scores()["free_share"] == pytest.approx(free)

    path = tmp_path / "mine.npz"
    Counts("mine", protocol_of(grid, own), CLIPS, [4, 0, 0], suite.counts()).write(path)
    table = Resamples({"mine": {0: Counts.read(path)}}).table().set_index("score")
    assert table.loc["free_share", "value"].tolist() == pytest.approx([free, free])


def test_a_file_of_counts_imports_nothing_and_a_module_that_there_is_not_is_refused(own, grid):
    protocol = protocol_of(grid, own)
    with pytest.raises(UserError, match=r"^suite.metrics.mine._target_: my_metrics.FreeShare"):
        ScoreSuite.of(Protocol.from_json(protocol.to_json()), CLIPS)
    assert "my_metrics" not in sys.modules
    import_metrics(own)
    assert ScoreSuite.of(protocol, CLIPS).metric("mine").free == 8
    with pytest.raises(UserError, match=r"^suite.metrics.mine._target_: .*nowhere"):
        import_metrics(with_entry("mine", _target_="nowhere.Mine"))
