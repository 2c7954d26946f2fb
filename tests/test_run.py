"""The program as its user meets it: commands, what they leave behind, and what they refuse."""

import re
import shutil
import tempfile
from pathlib import Path
from unittest.mock import Mock

import pandas as pd
import pytest
import torch
import yaml
from hydra.errors import InstantiationException
from lightning.pytorch.loggers.csv_logs import ExperimentWriter

from src.data.clip import Clip
from src.data.datamodule import SkyShieldData
from src.errors import UserError
from src.failures import one_line
from src.models.checkpoint import Checkpoint
from src.models.module import OccupancyModule, rate_share
from src.models.network import SkyOcc
from src.ontology import CLASSES
from src.results.counts import Counts
from src.results.files import SCORES, read_results
from src.run_folder import ANCHORS
from src.tasks import evaluate
from src.tasks.compare import compare
from src.tasks.dataset import root_of
from src.tasks.fit import fit
from src.tasks.predict import predict
from src.tasks.score import score as score_predictions
from src.tasks.session import data_of
from src.tasks.test import test as score
from tests.sessions import python
from tests.synthetic import compose_config, mini_overrides, untrained, write_dataset

FIT = ("+experiment=skyocc", "trainer.accelerator=cpu")


@pytest.fixture
def refusal(run_py):
    """Runs a command and returns the one line with which it is refused."""

    def refused(*overrides):
        status, _, (line,) = run_py(*overrides)
        assert status == 2
        assert line.startswith("error: ")
        return line

    return refused


@pytest.fixture(autouse=True)
def _quick(monkeypatch, unchecked):
    monkeypatch.setattr(evaluate, "SHOWN_FRAMES", 1)


@pytest.fixture
def unscored(monkeypatch):
    """A training ends without scores, which take most of its time."""

    def finish(session, module, folder):
        folder.results.touch()

    monkeypatch.setattr("src.tasks.fit.evaluate", finish)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a finished dataset of synthetic clips."""
    folder = tmp_path_factory.mktemp("place")
    write_dataset(compose_config(*mini_overrides(folder)))
    return folder


@pytest.fixture
def here(place, tmp_path):
    """A fresh folder for runs beside the shared dataset."""
    return [*mini_overrides(place, *FIT), f"paths.runs={tmp_path}/runs"]


@pytest.fixture(scope="module")
def printed(place):
    """What a whole program prints that trains without the simulator, nor any part of src.sim."""
    script = (
        "import runpy, sys\n"
        "for name in ('pybullet', 'embreex', 'src.sim'): sys.modules[name] = None\n"
        "from src.tasks import evaluate; evaluate.SHOWN_FRAMES = 1\n"
        "runpy.run_path('run.py', run_name='__main__')\n"
    )
    return python("-c", script, *mini_overrides(place, *FIT))


@pytest.fixture(scope="module")
def finished(place, printed):
    """The folder of that program's run, and the overrides that made it."""
    return place / "runs/tiny/skyocc/seed0", mini_overrides(place, *FIT)


def folder_of(overrides):
    return Path(compose_config(*overrides).paths.run)


def weights(path):
    return torch.load(path, weights_only=True)["state_dict"]


class Stop(Exception):
    """Stands for whatever ends a run."""


def at(epoch, batch):
    """A patch that ends training there, as a power cut would."""
    step = OccupancyModule.training_step

    def training_step(self, data, index):
        if (self.current_epoch, index) == (epoch, batch):
            raise Stop
        return step(self, data, index)

    return OccupancyModule, "training_step", training_step


@pytest.fixture
def interrupt(monkeypatch):
    """Trains until a patch raises `Stop`, and no further."""

    def interrupted(overrides, patch):
        with monkeypatch.context() as patched:
            patched.setattr(*patch)
            with pytest.raises(Stop):
                fit(compose_config(*overrides))

    return interrupted


@pytest.fixture
def half_done(here, made_once, interrupt, monkeypatch):
    """The overrides of a run that was killed while its second checkpoint was written.

    The system's folder for temporary files, often another disk, has no part in it.
    """
    save = torch.save

    def half(checkpoint, path):
        if "last" in path.name and checkpoint["epoch"] == 1:
            path.write_bytes(b"half of it")
            raise Stop
        save(checkpoint, path)

    def make(folder):
        monkeypatch.setattr(tempfile, "tempdir", "nowhere")
        interrupt([*here, f"paths.runs={folder}"], (torch, "save", half))

    shutil.copytree(made_once("half_done", make), folder_of(here).parents[2])
    return here


def require_same_training(folder, other):
    """Same weights to the last bit, and every epoch logged once."""
    mine, others = (weights(path / "checkpoints/last.ckpt") for path in (folder, other))
    assert mine.keys() == others.keys()
    assert all(torch.equal(value, others[name]) for name, value in mine.items())
    tables = [pd.read_csv(path / "metrics.csv") for path in (folder, other)]
    pd.testing.assert_frame_equal(*tables)


# -------------------------------------------------------------------------------- what a run leaves


def protocol_of(folder):
    """The file of the protocol that all rows of a run's results name."""
    (digest,) = read_results(folder / "results.csv")["protocol"].unique()
    return folder / f"protocol-{digest}.json"


def test_a_run_leaves_its_folder_complete(finished):
    folder, _ = finished
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names == {
        *("config.yaml", ".version", ".code", "class_weights.json", "metrics.csv", "results.csv"),
        *("checkpoints/best.ckpt", "checkpoints/last.ckpt"),
        *("figures/curves.png", "figures/qualitative.png", "figures/first_epoch.png"),
        *("scores.csv", "sessions/version_0/metrics.csv", protocol_of(folder).name),
        *(f"tallies/{name}.npz" for name in ("skyocc", *ANCHORS)),
    }
    assert yaml.safe_load((folder / "config.yaml").read_text())["name"] == "skyocc"
    assert set(yaml.safe_load((folder / "class_weights.json").read_text())) == set(CLASSES)
    for path in (folder / "checkpoints").iterdir():
        assert weights(path)  # torch.load refuses a pickle of anything but tensors
    table = pd.read_csv(folder / "metrics.csv")
    assert table.dropna(subset=["val/kar_miou"])["epoch"].tolist() == [0, 1]


def test_results_hold_every_score_of_the_model_and_the_anchors_on_every_part(finished):
    table = read_results(finished[0] / "results.csv")
    parts = ("test", "test_unseen_clips", "test_seen_clips")

    assert set(zip(table["experiment"], table["split"])) == {
        (name, part) for name in ("skyocc", *ANCHORS) for part in parts
    }
    assert len(table) == 12
    assert set(SCORES) <= set(table)
    assert table[["miou", "miou_occupied", "kar_miou"]].notna().all(axis=None)
    assert table["code_version"].str.fullmatch(r"[0-9a-f]{12}").all()
    assert table["dataset"].str.fullmatch(r"tiny-[0-9a-f]{12}").all()
    assert (table.loc[table["experiment"] == "skyocc", "parameters"] > 1000).all()
    assert set(zip(table["experiment"], table["precision"])) == {
        *(("skyocc", "32-true"), *((anchor, "none") for anchor in ANCHORS))
    }
    free = table[table["experiment"] == "all_free"].iloc[0]
    assert free["miou_occupied"] == 0
    assert free["iou/free"] > 0.3
    protocol = yaml.safe_load(protocol_of(finished[0]).read_text())
    assert protocol["grid"]["shape"] == [25, 25, 15]
    assert protocol["metric"]["horizon_s"] == 5.0
    assert protocol["dataset"] == table["dataset"].iloc[0]
    assert protocol["frames"] == 30 + 2  # a held-out clip, and the last second of the other


def test_the_same_command_again_shows_the_finished_run(finished, capsys, monkeypatch):
    folder, overrides = finished
    monkeypatch.setattr(*at(0, 0))
    before = (folder / "results.csv").stat().st_mtime_ns
    assert fit(compose_config(*overrides)) == "already finished, skipped"
    shown = capsys.readouterr().out
    assert "already finished" in shown
    assert "voxel_prior" in shown
    assert (folder / "results.csv").stat().st_mtime_ns == before


def test_it_says_what_it_trains_and_nothing_of_what_libraries_say(printed):
    assert printed.stderr == ""
    heading, generating, *stages, first, second = printed.stdout.splitlines()[:7]
    assert heading.startswith("skyocc, recipe strong, scale tiny, seed 0, in ")
    assert generating == "  1. generate 2 flights of 12 s: done before"
    begins = ["  2. train 2 epochs of 25 frames:", "  3. score 32 frames", "  4. draw predictions"]
    assert all(line.startswith(begin) for line, begin in zip(stages, begins, strict=True))
    assert re.fullmatch(
        r"skyocc, recipe strong, scale tiny, seed 0: 0\.\d+ M .* on cpu in 32-true, 2 epochs", first
    )
    assert second.endswith(": 25 / 3 / 32 frames to train / validate / test")
    assert "voxel_prior" in printed.stdout


# -------------------------------------------------------------------------- interrupted and resumed


def test_a_half_done_run_goes_on_as_if_undisturbed(finished, half_done, monkeypatch, unscored):
    """Same order, same mirrors, same schedule; and it does not count the labels once more."""
    folder = folder_of(half_done)
    assert not (folder / "results.csv").exists()
    monkeypatch.setattr(SkyShieldData, "labels", None)
    assert fit(compose_config(*half_done)) == "finished, went on after epoch 1 of 2"
    require_same_training(folder, finished[0])


def test_the_best_one_stays_and_no_later_one_is_trained_again(here, interrupt, unscored):
    """Here the first one is called the best, as its loss is the greatest."""
    overrides = [*here, "callbacks.best.monitor=val/loss", "trainer.max_epochs=3"]
    interrupt(overrides, at(2, 1))
    assert fit(compose_config(*overrides)) == "finished, went on after epoch 2 of 3"
    checkpoints = folder_of(here) / "checkpoints"
    assert {path.name for path in checkpoints.iterdir()} == {"best.ckpt", "last.ckpt"}
    epochs = [Checkpoint.read(checkpoints / f"{name}.ckpt").epochs for name in ("best", "last")]
    assert epochs == [1, 3]


def test_a_run_killed_before_its_results_repeats_no_training(finished, here, monkeypatch):
    results = shutil.ignore_patterns("results.csv", "scores.csv", "tallies", "figures")
    folder = folder_of(here)
    shutil.copytree(finished[0], folder, ignore=results)
    monkeypatch.setattr(*at(1, 0))
    assert fit(compose_config(*here)) == "finished, went on after epoch 2 of 2"
    again, before = (read_results(path / "results.csv") for path in (folder, finished[0]))
    columns = [name for name in again if name not in ("seconds", "git_commit")]
    pd.testing.assert_frame_equal(again[columns], before[columns])
    require_same_training(folder, finished[0])


def test_last_goes_on_and_no_other_configuration_code_or_broken_file(half_done, unscored):
    with pytest.raises(UserError, match=r"optimizer\.lr=0\.002.* 0\.1"):
        fit(compose_config(*half_done, "ckpt_path=last", "optimizer.lr=0.1"))
    last = folder_of(half_done) / "checkpoints/last.ckpt"
    ours, content = last.read_bytes(), torch.load(last, weights_only=True)
    content["skyshield"]["dataset"] = "others"
    torch.save(content, last)
    with pytest.raises(UserError, match=r"last\.ckpt was trained on others, and now .* tiny-"):
        fit(compose_config(*half_done, "ckpt_path=last"))
    content = torch.load(last, weights_only=True)
    content["skyshield"]["dataset"] = root_of(compose_config(*half_done)).name
    content["skyshield"]["code"]["models/losses.py"] = "0123456789ab"
    torch.save(content, last)
    with pytest.raises(UserError, match=r"last\.ckpt .*src/models/losses"):
        fit(compose_config(*half_done, "ckpt_path=last"))

    last.write_bytes(ours[:1000])
    for words in ([], ["ckpt_path=last"]):
        with pytest.raises(UserError, match=r"last\.ckpt is no readable checkpoint"):
            fit(compose_config(*half_done, *words))
    assert last.stat().st_size == 1000, "it is not replaced"

    last.write_bytes(ours)
    fit(compose_config(*half_done, "ckpt_path=last"))
    table = pd.read_csv(folder_of(half_done) / "metrics.csv")
    assert table.dropna(subset=["val/kar_miou"])["epoch"].tolist() == [0, 1]


def test_a_precision_holds_for_training_and_for_what_comes_after(here, monkeypatch):
    overrides = [*here, "trainer.precision=bf16-mixed", "trainer.max_epochs=1"]
    overrides += ["data.batch_size=2", "+trainer.limit_test_batches=1"]
    assert fit(compose_config(*overrides)) == "finished"
    table = read_results(folder_of(overrides) / "results.csv").set_index("experiment")
    assert set(table.loc["skyocc", "precision"]) == {"bf16-mixed"}
    forward, autocast = SkyOcc.forward, []

    def watched(self, batch):
        autocast.append(torch.is_autocast_enabled("cpu"))
        return forward(self, batch)

    monkeypatch.setattr(SkyOcc, "forward", watched)
    predict(compose_config(*overrides, "task=predict", "ckpt_path=last"), "val", logits=False)
    assert set(autocast) == {True}
    facts = yaml.safe_load((folder_of(overrides) / "predictions/val/predictions.json").read_text())
    assert facts["precision"] == "bf16-mixed"
    assert facts["held_out"] == {"val": [], "test": ["suburb/clip00"]}


def test_a_loss_that_cannot_be_built_is_refused_before_any_data_are_made(tmp_path):
    weights = "loss.terms.cross_entropy.class_weights=[1,2]"
    words = mini_overrides(tmp_path, *FIT, "loss/class_weights=manual", weights)
    with pytest.raises(InstantiationException) as told:
        fit(compose_config(*words))
    assert "cross_entropy.class_weights: [1.0, 2.0] are 2; give 9" in one_line(told.value)
    assert not any(tmp_path.iterdir())


def test_a_best_epoch_is_of_what_validation_logs_and_of_a_validation(here):
    with pytest.raises(UserError, match=r"^callbacks\.best\.monitor: 'val/foo'; .* val/kar_miou,"):
        fit(compose_config(*here, "callbacks.best.monitor=val/foo"))
    assert not folder_of(here).exists()
    with pytest.raises(UserError, match=r"skyocc/seed0: has no best\.ckpt, as no validation"):
        fit(compose_config(*here, "+trainer.max_steps=1"))


def test_fit_goes_on_neither_from_nothing_nor_from_another_run(finished, here):
    with pytest.raises(UserError, match=r"ckpt_path: no checkpoint .*last\.ckpt"):
        fit(compose_config(*here, "ckpt_path=last"))
    with pytest.raises(UserError, match=r"ckpt_path: .*paths\.run"):
        fit(compose_config(*here, f"ckpt_path={finished[0]}/checkpoints/last.ckpt"))


@pytest.mark.parametrize("late", [False, True])
def test_what_cannot_be_done_is_refused_before_a_finished_run_is_moved(finished, late, monkeypatch):
    """A device that there is not, or labels that cannot be read, for another training there."""
    folder, overrides = finished
    overrides = [*overrides, "optimizer.lr=0.1", *([] if late else ["trainer.accelerator=tpu"])]
    if late:
        monkeypatch.setattr(Clip, "semantics", lambda *_: Path("gone.npz").read_bytes())
    with pytest.raises((UserError, FileNotFoundError), match=r"finds only cpu|gone\.npz"):
        fit(compose_config(*overrides))
    assert (folder / "results.csv").is_file()
    assert not folder.with_name("seed0.before1").exists()


def test_overwriting_trains_anew_and_keeps_the_old_run_aside(finished, here, interrupt):
    shutil.copytree(finished[0], folder_of(here))
    interrupt([*here, "overwrite=true"], at(0, 0))
    aside = folder_of(here).with_name("seed0.before1")
    assert (aside / "results.csv").read_bytes() == (finished[0] / "results.csv").read_bytes()
    assert not (folder_of(here) / "results.csv").exists()


# ----------------------------------------------------------------------------- scoring a checkpoint


def test_scoring_a_checkpoint_repeats_the_run_s_own_scores_or_says_of_how_much_they_are(finished):
    folder, overrides = finished
    score(compose_config(*overrides, "task=test", "ckpt_path=best"))
    again, first = (read_results(path / "results.csv") for path in (folder / "test", folder))
    columns = ["experiment", "split", *SCORES, "dataset", "code_version"]
    pd.testing.assert_frame_equal(again[columns], first[columns])

    # What is scored in part says so.
    few = ("data.batch_size=2", "+trainer.limit_test_batches=1")
    score(compose_config(*overrides, *few, "task=test", "ckpt_path=best"))
    part = {path.stem: Counts.read(path) for path in (folder / "test/tallies").iterdir()}
    frames = {sum(tally.frames) for tally in part.values()}
    assert frames == {tally.protocol.frames for tally in part.values()} == {2}
    counted = [tally.tables["occupancy"]["count"].sum((1, 2)).tolist() for tally in part.values()]
    assert counted[0] == counted[1] == counted[2], "the anchors are scored on the same frames"
    with pytest.raises(UserError, match="was scored with frames=2"):
        compare(compose_config(), [str(folder), str(folder / "test")], str(folder / "out"))


def test_predictions_on_disk_score_as_the_run_itself(finished, tmp_path):
    folder, overrides = finished
    overrides = [*overrides, f"predictions={tmp_path}/mine"]
    predict(compose_config(*overrides, "task=predict", "ckpt_path=best"), "test", logits=True)
    score_predictions(compose_config(*overrides, "task=score"), "test", False, None)
    again = read_results(tmp_path / "mine/scores/results.csv")
    first = read_results(folder / "results.csv")
    recipes = first.groupby("experiment")["recipe"].agg(set).to_dict()
    assert recipes == {"skyocc": {"strong"}, **{name: {"none"} for name in ANCHORS}}
    first = first[first["experiment"] == "skyocc"].reset_index(drop=True)
    columns = ["experiment", "scale", "seed", "split", "recipe", *SCORES, "protocol"]
    columns += ["parameters", "code_version", "dataset", "precision"]
    tables = [rows[columns].sort_values("split", ignore_index=True) for rows in (again, first)]
    pd.testing.assert_frame_equal(*tables)
    whole, kept = (
        pd.read_csv(path / "scores.csv").query("experiment == 'skyocc'").set_index("score")
        for path in (tmp_path / "mine/scores", folder)
    )
    # The class scores were rounded to half precision, and nothing else.
    of_logits = kept.index.str.startswith(("ece", "nll", "primitive_", "occupied_", "tube_"))
    of_logits &= ~kept.index.str.endswith("_argmax")
    assert kept[of_logits]["value"].notna().sum() > 3
    pd.testing.assert_frame_equal(whole[~of_logits], kept[~of_logits], atol=1e-6, rtol=0)
    pd.testing.assert_frame_equal(whole[of_logits], kept[of_logits], atol=1e-3, rtol=0)


def test_a_checkpoint_is_not_scored_as_another_rung(finished):
    """Its weights would fit."""
    folder, overrides = finished
    checkpoint = f"ckpt_path={folder}/checkpoints/best.ckpt"
    with pytest.raises(UserError, match=r"lovasz.weight=1\.0.* 0\.0"):
        score(compose_config(*overrides, "loss/lovasz='off'", "task=test", checkpoint))


# ---------------------------------------------------------------------------------------- bad input


# What is typed, and what the line must name: the key, and the value or the way out.
MISTAKES = {
    "+experiment=skyoc": "experiment: .*'skyoc'.*'skyocc'.* baseline",
    "experiment=skyocc": r"\+experiment=skyocc",
    "sede=3": "sede: .*'seed'",
    "loss/class_weight=manual": "loss/class_weight: no such key; did you mean 'loss/class_weights'",
    "nonsense": "nonsense",
    "+experiment=baseline attitude": "'attitude': .*key=value",
    "optimizer.rule._target_=torch.optim.Adamm": "torch.optim.Adamm.*optimizer.rule",
    "metric.horizon_s=-1": "horizon_s: -1",
    "size.heads=3": "size.heads: 3 .*size.dim, 64",
    "model.history=foo": "model.history: 'foo'.*queue, recursive",
    "trainer.accelerator=cpu trainer.precision=16-mixed": "trainer.precision: .*16-mixed; give",
    "trainer.accelerator=tpu": "trainer.accelerator: tpu.*cpu",
    "trainer.strategy=no": "trainer: .*strategy name",
    "+split=flights": r"data.test_clips: no clip 'suburb/clip03'.*\(24 clips\)",
    "task=predict": "ckpt_path: task=predict",
    "task=predict task.part=tests": "task.part: 'tests'",
    "task=predict task.animation=flight.mp4": r"task.animation: 'flight\.mp4'; .*\.gif",
    "task=compare": "task.runs: ",
    "task=report": "/runs/small: .*task.runs",
}


@pytest.mark.parametrize("typed", MISTAKES)
def test_a_mistake_in_a_command_is_one_line_and_makes_nothing(typed, tmp_path, refusal):
    line = refusal(*typed.split(" "), f"paths.data={tmp_path}/data", f"paths.runs={tmp_path}/runs")
    assert re.search(MISTAKES[typed], line)
    assert not list(tmp_path.iterdir())


def test_data_made_under_another_configuration_are_refused(place, here, refusal):
    (made,) = (place / "data").iterdir()
    manifest = (made / "manifest.json").read_bytes()
    asked = (f"paths.dataset={made}", "sim.seed=7")
    assert re.search("sim.seed=0.* 7", refusal(*here, *asked))
    assert "paths.dataset" in refusal(*here, *asked, "task=generate")
    assert (made / "manifest.json").read_bytes() == manifest
    assert not folder_of(here).exists()


@pytest.mark.parametrize("key", ["paths.data", "paths.runs"])
def test_a_place_that_cannot_be_written_is_named(here, tmp_path, key, refusal):
    """Below a file nobody can make a folder, not even root."""
    (tmp_path / "file").write_text("")
    line = refusal(*here, f"{key}={tmp_path}/file/below")
    assert str(tmp_path / "file") in line


def test_a_full_disk_is_one_line_and_leaves_the_checkpoint(here, monkeypatch):
    full = OSError(28, "No space left on device", "metrics.csv")
    monkeypatch.setattr(ExperimentWriter, "save", Mock(side_effect=full))
    with pytest.raises(OSError, match="No space") as info:
        fit(compose_config(*here))
    assert one_line(info.value) == "metrics.csv: the disk is full; free some space and run it again"


def test_a_loss_that_is_not_finite_keeps_the_last_good_checkpoint(here, monkeypatch):
    output = OccupancyModule.training_output

    def poisoned(self, batch):
        step = output(self, batch)
        return step._replace(logits=step.logits * (torch.nan if self.current_epoch == 1 else 1))

    monkeypatch.setattr(OccupancyModule, "training_output", poisoned)
    with pytest.raises(UserError, match=r"not finite .* epoch 1, step 3, in the batch downtown"):
        fit(compose_config(*here))
    for name in ("best", "last"):
        kept = weights(folder_of(here) / f"checkpoints/{name}.ckpt")
        assert all(value.isfinite().all() for value in kept.values())


# ----------------------------------------------------------------------------------------- learning


@pytest.mark.slow
def test_four_samples_can_be_learnt_by_heart(mini_dataset, tmp_path):
    """Generated frames, network, loss and scores: the loss falls tenfold, the score passes 0.9."""
    overrides = mini_overrides(tmp_path, *FIT, "data.mirror=false", "data.batch_size=4")
    cfg = compose_config(*overrides, "data.val_clips=[]", "data.test_clips=[suburb/clip01]")
    data = data_of(cfg, mini_dataset)
    data.split["train"] = [("suburb/clip00", frame) for frame in (4, 10, 16, 22)]
    module = untrained(cfg, data)
    batch = next(iter(data.train_dataloader()))
    optimizer = torch.optim.AdamW(module.network.parameters())
    losses = []

    for step in range(300):
        optimizer.param_groups[0]["lr"] = 5e-3 * rate_share(step, 300, 0.1)
        loss = module.loss(module(batch), batch["semantics"])["total"]
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    scores = module.val_scores
    scores.update(module.eval()(batch).detach(), batch["semantics"], batch["velocity_mps"])
    assert losses[-1] < losses[0] / 10
    assert scores.compute()["miou_occupied"] > 0.9
