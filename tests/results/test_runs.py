"""Run folders as a report finds them."""

import pytest

from src.errors import UserError
from src.results.runs import ScoredRun, UnfinishedRun, read_run, run_folders
from src.run_folder import ANCHORS
from tests.results.scored import config_of, write_run

OUT = "report"


def empty_run(folder):
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text("name: x\n")
    return folder


def found(place, *more):
    paths = run_folders([place, *more], place / OUT)
    return [path.relative_to(place).as_posix() for path in paths]


# --------------------------------------------------------------------------------- where they are


def test_runs_lie_below_a_scale_an_experiment_or_all_of_them(tmp_path):
    for name in ("tiny/a/seed0", "tiny/a/seed1", "tiny/b/seed0"):
        empty_run(tmp_path / name)
    assert found(tmp_path) == ["tiny/a/seed0", "tiny/a/seed1", "tiny/b/seed0"]
    assert found(tmp_path / "tiny") == ["a/seed0", "a/seed1", "b/seed0"]
    assert found(tmp_path / "tiny/a") == ["seed0", "seed1"]
    assert run_folders([tmp_path / "tiny/a/seed1"], tmp_path) == [tmp_path / "tiny/a/seed1"]
    assert len(found(tmp_path, tmp_path / "tiny", tmp_path / "tiny/a/seed0")) == 3, "each once"


def test_what_is_no_run_of_the_sweep_is_passed_over(tmp_path):
    for name in ("a/seed0", "a/seed0.before1", "a/.seed1", ".b/seed0", f"{OUT}/a/seed5"):
        empty_run(tmp_path / name)
    empty_run(tmp_path / "a/seed0/test")
    (tmp_path / OUT / "tables").mkdir()
    assert found(tmp_path) == ["a/seed0"]
    aside = tmp_path / "a/seed0.before1"
    assert run_folders([aside], tmp_path / OUT) == [aside], "it may be named"


def test_places_without_a_run_are_refused(tmp_path):
    with pytest.raises(UserError, match=r"nowhere: no such folder; train first"):
        run_folders([tmp_path / "nowhere"], tmp_path / OUT)
    (tmp_path / "a").mkdir()
    with pytest.raises(UserError, match=r": holds no run folder; train first"):
        run_folders([tmp_path], tmp_path / OUT)


# ------------------------------------------------------------------------------ what is in them


def test_a_finished_run_is_read_with_its_anchors(tmp_path):
    run = read_run(write_run(tmp_path, "skyocc", 2))
    assert isinstance(run, ScoredRun)
    assert (run.experiment, run.seed, run.code) == ("skyocc", 2, "code c0de")
    assert str(run) == "skyocc seed 2"
    assert list(run.anchors) == list(ANCHORS)
    assert run.counts.name == "skyocc"
    assert run.row["split"] == "test"
    assert read_run(write_run(tmp_path, code=None)).code == "unknown code"


@pytest.mark.parametrize(
    ("log", "said"),
    [
        ("step,epoch,val\n1,0,\n9,2,0.5\n", "3 of 8 epochs logged"),
        ("", "no epoch logged"),
        ("step\n1\n", "no epoch logged"),
        ("epoch\nwhat\n", "no epoch logged"),
        (None, "no epoch logged"),
    ],
)
def test_a_run_without_results_is_unfinished(tmp_path, log, said):
    folder = write_run(tmp_path)
    (folder / "results.csv").unlink()
    # The logs of sessions are joined only by a training that ends in good order.
    for number, text in enumerate(("", log) if log is not None else ()):
        session = folder / f"sessions/version_{number}"
        session.mkdir(parents=True)
        (session / "metrics.csv").write_text(text)
    run = read_run(folder)
    assert isinstance(run, UnfinishedRun)
    assert str(run) == f"skyocc seed 0: unfinished, {said}"


# ------------------------------------------------------------------------- what cannot be read


def cut(name):
    def damage(folder):
        path = folder / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return damage


def without(name):
    return lambda folder: (folder / name).unlink()


def only_anchors(folder):
    path = folder / "results.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("skyocc,")))


def config_without_data(folder):
    config = config_of("skyocc", 0)
    del config["data"]
    (folder / "config.yaml").write_text(str(config))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (without("config.yaml"), r"config\.yaml: cannot be read .*so this is no run's folder"),
        (cut("config.yaml"), r"config\.yaml: "),
        (config_without_data, r"config\.yaml: has no data\.frames, so this is no run's folder"),
        (cut("results.csv"), r"results\.csv: not a readable results file"),
        (only_anchors, r"results\.csv: has no test scores of skyocc, only of all_free, vox"),
        (cut("tallies/skyocc.npz"), r"skyocc\.npz: cannot be read"),
        (without("tallies/skyocc.npz"), r"skyocc\.npz: no such file; give the command of its run"),
        (cut("tallies/voxel_prior.npz"), r"voxel_prior\.npz: cannot be read"),
    ],
)
def test_a_broken_run_is_named_in_one_line(tmp_path, damage, said):
    folder = write_run(tmp_path)
    damage(folder)
    with pytest.raises(UserError, match=said) as caught:
        read_run(folder)
    assert str(caught.value).startswith(str(folder))
    assert "\n" not in str(caught.value)


def test_an_empty_run_folder_is_named(tmp_path):
    (tmp_path / "skyocc/seed0").mkdir(parents=True)
    (path,) = run_folders([tmp_path], tmp_path / OUT)
    with pytest.raises(UserError, match=r"skyocc/seed0/config\.yaml: cannot be read"):
        read_run(path)
