"""task=sensitivity as its user meets it."""

import pandas as pd
import pytest

from src.errors import UserError
from src.metrics.protocol import SUPERVISED, Protocol
from src.results.counts import Counts
from src.tasks.scoring import score_settings
from studies.sensitivity.task import sensitivity
from tests.results.scored import FRAMES, GRID, counts, predicted
from tests.synthetic import compose_config


@pytest.fixture(scope="module")
def cfg():
    return compose_config("suite=sensitivity")


@pytest.fixture
def scored(cfg, tmp_path):
    """Counts predictions by the suite of a command, and returns their file."""

    def write(name, predict, cfg=cfg):
        of = Protocol.of("mini-0", "test", sum(FRAMES), GRID, SUPERVISED, *score_settings(cfg))
        counts(name, predict, of=of).write(tmp_path / f"{name}.npz")
        return str(tmp_path / f"{name}.npz")

    return write


@pytest.fixture
def blind(scored):
    return scored("blind", lambda target, n: predicted(target, 0.5, n))


def ranks_of(folder):
    return pd.read_csv(folder / "sensitivity.csv").filter(like="rank")


def test_the_better_run_ranks_first_whatever_the_parameters(cfg, scored, blind, tmp_path, capsys):
    perfect = scored("perfect", lambda target, n: target)
    sensitivity(cfg, [blind, perfect], str(tmp_path / "out"))
    ranks = ranks_of(tmp_path / "out")
    assert len(ranks) == 81
    assert (ranks["rank perfect"] == 1).all()
    assert (tmp_path / "out/sensitivity.png").stat().st_size > 10_000
    assert "under 81 settings of KAR-mIoU: 1" in capsys.readouterr().out


def test_what_rounding_alone_tells_apart_shares_a_rank(cfg, blind, tmp_path):
    counts = Counts.read(blind)
    for table in counts.tables["sensitivity"].values():
        table *= 10_000  # as many voxels as a dataset has
    counts.write(blind)
    excess = counts.tables["sensitivity"]["excess"]
    excess[..., 0] += excess[..., 0] > 0  # the least step of these fixed-point numbers
    counts.write(tmp_path / "again.npz")

    sensitivity(cfg, [blind, str(tmp_path / "again.npz")], str(tmp_path / "out"))
    ranks = ranks_of(tmp_path / "out")
    assert ranks.shape == (81, 2)
    assert (ranks == 1).all(axis=None)


def test_a_run_that_was_scored_without_it_and_no_run_are_refused(cfg, scored, tmp_path):
    plain = scored("plain", lambda target, n: target, compose_config())
    for runs, message in (
        ([], "^task.runs: name one or more"),
        ([plain], "^plain: has no counts .* suite=sensitivity"),
        ([tmp_path / "nowhere"], "^task.runs: .*nowhere is neither"),
    ):
        with pytest.raises(UserError, match=message):
            sensitivity(cfg, runs, str(tmp_path / "out"))
        assert not (tmp_path / "out").exists()
