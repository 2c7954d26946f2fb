"""What is in a run's folder, and whether a run may go on there."""

import pandas as pd
import pytest
import yaml

from src import run_folder
from src.dotted import differences
from src.errors import UserError
from src.run_folder import (
    ANCHORS,
    KEYS,
    RunFolder,
    read_config,
    recorded_code,
    require_same_config,
)


def config(folder, **changes):
    return {
        "name": "skyocc",
        "seed": 0,
        "model": {"dim": 16, "projection": "attitude"},
        "paths": {"run": str(folder)},
        "callbacks": {"save": {"dirpath": f"{folder}/checkpoints", "monitor": "val/kar_miou"}},
        "data": {"workers": 1, "batch_size": 8},
        "sim": {"workers": None, "dry_run": False, "seed": 0},
        "threads": None,
        "trainer": {"log_every_n_steps": 10},
        **changes,
    }


def folder_of(path, dataset="mini-0", **changes):
    return RunFolder(path, config(path, **changes), dataset)


def half_done(path, **changes):
    folder = folder_of(path, **changes)
    assert folder.open(afresh=False) is None
    folder.last_checkpoint.parent.mkdir()
    folder.last_checkpoint.write_text("weights")
    return folder


def test_a_run_killed_before_its_first_checkpoint_begins_again_where_it_is(tmp_path):
    """Nothing is lost, so nothing is moved aside."""
    folder = folder_of(tmp_path / "seed0")
    assert folder.open(afresh=False) is None
    assert yaml.safe_load((folder.path / "config.yaml").read_text()) == folder.config
    assert not folder.is_finished()
    folder.write_json("class_weights.json", {"car": 5.0})
    (folder.path / "sessions/version_0").mkdir(parents=True)
    (folder.path / ".class_weights.json.17.tmp").write_text("half of it")
    again = folder_of(tmp_path / "seed0", threads=2)
    assert again.open(afresh=False) is None
    assert [path.name for path in tmp_path.iterdir()] == ["seed0"]
    names = {path.name for path in folder.path.iterdir()}
    assert names == {"config.yaml", ".version", ".code", "class_weights.json"}
    assert yaml.safe_load((folder.path / "config.yaml").read_text())["threads"] == 2


def test_a_best_checkpoint_without_a_last_one_is_moved_aside(tmp_path):
    """As its user was told to do: move the broken last one away to start anew."""
    folder = half_done(tmp_path / "seed0")
    folder.last_checkpoint.rename(folder.best_checkpoint)
    assert folder_of(tmp_path / "seed0").open(afresh=False) is None
    assert (tmp_path / "seed0.before1/checkpoints/best.ckpt").is_file()


def test_a_half_done_run_goes_on_where_it_was_moved_to_without_what_was_half_written(tmp_path):
    half_done(tmp_path / "here")
    (tmp_path / "here/checkpoints/.last.ckpt.17.tmp").write_text("half of it")
    (tmp_path / "here").rename(tmp_path / "there")
    last = tmp_path / "there/checkpoints/last.ckpt"
    assert folder_of(tmp_path / "there").open(afresh=False) == last
    assert [path.name for path in last.parent.iterdir()] == ["last.ckpt"]


class Waiting(Exception):
    """Ends what would wait."""


def test_a_second_process_of_a_run_waits_and_says_so(tmp_path, monkeypatch):
    def wait(line):
        raise Waiting(line)

    monkeypatch.setattr("src.locks.say", wait)
    path = tmp_path / "seed0"
    with folder_of(path).alone(), pytest.raises(Waiting, match=f"^{path}: "):
        folder_of(path).alone().__enter__()
    with folder_of(path).alone():
        pass


def test_where_there_are_no_locks_nobody_waits(tmp_path, no_locks):
    with folder_of(tmp_path / "seed0").alone(), folder_of(tmp_path / "seed0").alone():
        pass


def test_another_configuration_or_afresh_moves_the_old_run_aside(tmp_path):
    half_done(tmp_path / "seed0")
    other = half_done(tmp_path / "seed0", seed=1)
    assert other.open(afresh=True) is None
    assert not other.last_checkpoint.exists()
    for aside, seed in (("seed0.before1", 0), ("seed0.before2", 1)):
        assert yaml.safe_load((tmp_path / aside / "config.yaml").read_text())["seed"] == seed
        assert (tmp_path / aside / "checkpoints/last.ckpt").read_text() == "weights"


def test_finished_means_results_of_this_very_configuration(tmp_path):
    folder = half_done(tmp_path / "seed0")
    tallies = [f"tallies/{name}.npz" for name in ("skyocc", *ANCHORS)]
    files = [folder.path / name for name in ("results.csv", "scores.csv", *tallies)]
    files[2].parent.mkdir()
    for file in files:
        file.write_text("experiment\n")
    assert folder_of(tmp_path / "seed0").is_finished()
    assert not folder_of(tmp_path / "seed0", seed=1).is_finished()
    for file in files:
        file.rename(tmp_path / "away")
        assert not folder_of(tmp_path / "seed0").is_finished(), f"{file.name} is a part of them"
        (tmp_path / "away").rename(file)
    assert folder_of(tmp_path / "seed0").is_finished()


def test_what_shapes_a_result_changes_the_version_and_nothing_else(tmp_path):
    version = folder_of(tmp_path).version
    elsewhere = {
        **{"threads": 2, "ckpt_path": "last", "data": {"workers": 4, "batch_size": 8}},
        **{"sim": {"workers": 2, "dry_run": True, "seed": 0}, "trainer": {"log_every_n_steps": 7}},
        **{"logger": {"flush_logs_every_n_steps": 5}},
        **{"recipe_name": "mine", "group": "tiny-mine"},  # only its own keys shape anything
    }
    assert folder_of(tmp_path, **elsewhere).version == version
    shaping = {"seed": 1, "model": {"dim": 32}, "data": {"batch_size": 4}, "dataset": "mini-1"}
    for key, value in shaping.items():
        assert folder_of(tmp_path, **{key: value}).version != version, key


def test_the_code_of_a_run_is_recorded_file_by_file(tmp_path):
    folder = half_done(tmp_path / "a")
    assert recorded_code(folder.path) == folder.code
    assert "tasks/model.py" in folder.code
    (folder.path / ".code").write_text("0123456789ab\n")
    assert recorded_code(folder.path) == {"": "0123456789ab"}, "of runs before format 2"
    (folder.path / ".code").unlink()
    assert recorded_code(folder.path) == {}


def test_what_is_moved_aside_is_told_with_the_file_that_differs(tmp_path, monkeypatch, capsys):
    code = half_done(tmp_path / "seed0").code
    other = {**code, "models/module.py": "0123456789ab"}
    monkeypatch.setattr(run_folder, "code_of", lambda parts: other)
    assert folder_of(tmp_path / "seed0").open(afresh=False) is None
    line = capsys.readouterr().out
    assert "seed0.before1" in line
    assert "src/models/module.py" in line


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": {"dim": 16, "projection": "level"}}, 'model.projection="attitude".*"level"'),
        ({"data": {"workers": 1, "batch_size": 4}}, "data.batch_size=8.* 4"),
        ({"seed": 1}, "seed=0.* 1"),
        ({"loss": {"lovasz_weight": 0.0}}, "loss=null.*lovasz_weight"),
    ],
)
def test_a_checkpoint_of_another_configuration_is_refused_by_its_key(tmp_path, change, message):
    """Weights of another rung or seed would fit, so its identity is compared before it is used."""
    path, before, now = tmp_path / "last.ckpt", config(tmp_path), config(tmp_path, **change)
    require_same_config(path, before, before)
    with pytest.raises(UserError, match=message):
        require_same_config(path, before, now)
    if "data" in change:
        require_same_config(path, before, now, KEYS["identity"])
    else:
        with pytest.raises(UserError, match=message):
            require_same_config(path, before, now, KEYS["identity"])


def test_what_the_encoder_began_with_says_nothing_of_a_checkpoints_network(tmp_path):
    path = tmp_path / "last.ckpt"
    began, other = ({"model": {"backbone": {"weights": w}}} for w in ("encoder.pth", None))
    require_same_config(path, began, other, KEYS["identity"])
    with pytest.raises(UserError, match=r'weights="encoder\.pth".* null'):
        require_same_config(path, began, other)


@pytest.mark.parametrize("content", [None, "", "- a list", "{", "name: x"])
def test_an_unreadable_config_is_named(tmp_path, content):
    path = half_done(tmp_path / "seed0").path / "config.yaml"
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(UserError, match=r"config\.yaml: cannot be read \(") as caught:
        read_config(path, "so it is none")
    assert "\n" not in str(caught.value)
    assert "object is not" not in str(caught.value), "the words of Python"


@pytest.mark.parametrize(
    ("sessions", "joined"),
    [
        # The second goes on from step 10, so what the first logged beyond that was lost.
        (
            [{"step": [4, 9, 14], "loss": [5.0, 4.0, -1.0]}, {"step": [12], "loss": [3.0]}],
            {"step": [4, 9, 12], "loss": [5.0, 4.0, 3.0]},
        ),
        # Training and validation of a step share a row.
        (
            [{"step": [9, 9], "loss": [4.0, None], "val": [None, 0.5]}],
            {"step": [9], "loss": [4.0], "val": [0.5]},
        ),
        # The tenth follows the ninth.
        ([{"step": [n]} for n in range(12)], {"step": list(range(12))}),
        # One that logged nothing loses nothing.
        ([{"step": [1]}, {"step": []}, None], {"step": [1]}),
    ],
)
def test_metrics_of_sessions_are_joined(tmp_path, sessions, joined):
    folder = half_done(tmp_path / "seed0")
    for number, rows in enumerate(sessions):
        log = folder.path / "sessions" / f"version_{number}/metrics.csv"
        log.parent.mkdir(parents=True)
        log.write_text("" if rows is None else pd.DataFrame(rows).to_csv(index=False))
    folder.merge_metrics()
    assert pd.read_csv(folder.metrics).to_dict("list") == joined


def test_differences_are_dotted_keys():
    before, after = {"a": {"b": 1, "c": 2}, "d": 1}, {"a": {"b": 1, "c": 3}, "e": None, "d": 1}
    assert [*differences(before, after)] == [("a.c", 2, 3)]
