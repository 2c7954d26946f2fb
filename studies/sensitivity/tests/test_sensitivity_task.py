"""task=sensitivity as its user meets it."""

import pandas as pd
import pytest
import torch
from omegaconf import OmegaConf

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics.protocol import SUPERVISED, Protocol
from src.metrics.suite import ScoreSuite, import_metrics
from src.ontology import FREE
from src.results.counts import Counts
from studies.sensitivity.task import sensitivity
from tests.synthetic import compose_config

GRID = VoxelGrid(lower_m=(0, -10, -4), upper_m=(20, 10, 4), shape=(40, 40, 16))
CLIPS = ["town/a", "town/b"]


@pytest.fixture(scope="module")
def cfg():
    return compose_config("suite=sensitivity")


@pytest.fixture(scope="module")
def labels():
    generator = torch.Generator().manual_seed(0)
    size = (len(CLIPS), *GRID.shape)
    return torch.randint(0, 20, size, generator=generator).clamp(max=FREE).to(torch.uint8)


@pytest.fixture
def scored(cfg, labels, tmp_path):
    """Counts predictions of the labels by the suite of a command, and returns their file."""

    def write(name, preds, cfg=cfg):
        metric, suite = (
            OmegaConf.to_container(cfg[key], resolve=True) for key in ("metric", "suite")
        )
        import_metrics(suite)
        protocol = Protocol.of("mini-0", "test", 2, GRID, SUPERVISED, metric, suite)
        counting = ScoreSuite.of(protocol, CLIPS)
        velocity = torch.tensor([[9.0, 0, 0], [3.0, 0, 0]])
        counting.update(preds, {"clip": CLIPS, "semantics": labels, "velocity_mps": velocity})
        Counts(name, protocol, CLIPS, [1, 1], counting.counts()).write(tmp_path / f"{name}.npz")
        return str(tmp_path / f"{name}.npz")

    return write


@pytest.fixture
def blind(scored, labels):
    half = torch.arange(GRID.shape[0])[:, None, None] % 2 > 0
    return scored("blind", torch.where(half, labels, FREE).byte())


def ranks_of(folder):
    return pd.read_csv(folder / "sensitivity.csv").filter(like="rank")


def test_the_better_run_ranks_first_whatever_the_parameters(
    cfg, scored, labels, blind, tmp_path, capsys
):
    sensitivity(cfg, [blind, scored("perfect", labels)], str(tmp_path / "out"))
    ranks = ranks_of(tmp_path / "out")
    assert len(ranks) == 81
    assert (ranks["rank perfect"] == 1).all()
    assert (tmp_path / "out/sensitivity.png").stat().st_size > 10_000
    assert "under 81 settings of KAR-mIoU: 1" in capsys.readouterr().out


def test_what_rounding_alone_tells_apart_shares_a_rank(cfg, blind, tmp_path):
    counts = Counts.read(blind)
    excess = counts.tables["sensitivity"]["excess"]
    excess[..., 0] += excess[..., 0] > 0  # the least step of these fixed-point numbers
    counts.write(tmp_path / "again.npz")

    sensitivity(cfg, [blind, str(tmp_path / "again.npz")], str(tmp_path / "out"))
    ranks = ranks_of(tmp_path / "out")
    assert ranks.shape == (81, 2)
    assert (ranks == 1).all(axis=None)


def test_a_run_that_was_scored_without_it_and_no_run_are_refused(cfg, scored, labels, tmp_path):
    plain = scored("plain", labels, compose_config())
    for runs, message in (
        ([], "^task.runs: name one or more"),
        ([plain], "^plain: has no counts .* suite=sensitivity"),
        ([tmp_path / "nowhere"], "^task.runs: .*nowhere is neither"),
    ):
        with pytest.raises(UserError, match=message):
            sensitivity(cfg, runs, str(tmp_path / "out"))
        assert not (tmp_path / "out").exists()
