"""A checkpoint stands alone: what needs one needs no training label, and no more than it uses."""

import hashlib
import re
import shutil
from pathlib import Path

import pytest
import torch

from src.data.clip import Clip
from src.data.datamodule import SkyShieldData
from src.errors import UserError
from src.models.checkpoint import Checkpoint
from src.models.export import DESCRIPTION, FORMATS
from src.models.stream import SkyOccStream
from src.models.weights import read_encoder
from src.settings import adopted
from src.tasks.dataset import root_of
from src.tasks.export import export, made_up_flight
from src.tasks.predict import predict
from src.tasks.scoring import score_settings
from src.tasks.session import Session
from studies.attitude.task import attitude
from tests.synthetic import compose_config

DOCS = Path(__file__).parents[2] / "docs"
ATTITUDE = {"tilt_edges_deg": [5.0], "noise_deg": [], "delay_s": [], "seed": 0, "level": False}


@pytest.fixture(scope="module")
def cfg(trained):
    """The configuration that the checkpoint was trained with."""
    return compose_config(*trained)


@pytest.fixture
def configured(cfg, checkpoint, tmp_path):
    """The configuration of a command that names the checkpoint, and places of its own."""
    shutil.copytree(root_of(cfg), tmp_path / "data" / root_of(cfg).name)
    places = [f"paths.data={tmp_path}/data", f"paths.runs={tmp_path}/runs"]
    always = ["data.workers=0", "trainer.accelerator=cpu", f"ckpt_path={checkpoint}", *places]

    def config(*more):
        return adopted(compose_config(*always, *more), [*always, *more])

    return config


def files_below(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


# ------------------------------------------------------------------------ whose configuration holds


def test_its_own_configuration_is_used_where_the_command_says_nothing(configured, cfg, checkpoint):
    own = configured("task=predict", "data.batch_size=3", "suite.rays=[6,4]", "threads=1")
    assert (own.name, own.scale_name, own.model.encoder.dim) == ("skyocc", "tiny", 16)
    assert (own.data.batch_size, own.suite.metrics.rays.rays, own.threads) == (3, [6, 4], 1)
    assert own.paths.run.endswith("/runs/tiny/skyocc/seed0")
    assert root_of(own).name == root_of(cfg).name
    assert Session(own).checkpoint("predict").path == checkpoint


def test_weights_of_an_older_suite_are_scored_with_all_of_todays_metrics():
    """Those that are published here are of some earlier day; of a metric that they do not know,
    they do not know the settings either."""
    (weights,) = Path("weights").glob("*.ckpt")
    command = ["task=test", f"ckpt_path={weights}"]
    cfg = adopted(compose_config(*command), command)
    assert cfg.recipe_name == "strong"
    _, suite = score_settings(cfg)
    assert set(suite["metrics"]) == set(compose_config("task=test").suite.metrics)


def test_its_recipe_is_named_and_its_run_is_found_where_the_command_says_nothing(
    configured, checkpoint, tmp_path
):
    content = torch.load(checkpoint, weights_only=True)
    del content["skyshield"]["config"]["recipe_name"]
    torch.save(content, tmp_path / "older.ckpt")
    assert configured("task=test", f"ckpt_path={tmp_path}/older.ckpt").recipe_name == "unknown"

    content["skyshield"]["config"].update(recipe_name="paper", group="tiny-paper")
    torch.save(content, tmp_path / "paper.ckpt")
    own = configured("task=test", f"ckpt_path={tmp_path}/paper.ckpt")
    assert Session(own).checkpoint("test").origin.config["recipe_name"] == own.recipe_name
    digest = hashlib.sha256((tmp_path / "paper.ckpt").read_bytes()).hexdigest()
    weights = f"{tmp_path}/runs/weights"
    assert own.paths.run == f"{weights}/paper-{digest[:8]}", "in no run of one's own"
    (tmp_path / "paper.ckpt").rename(named := tmp_path / f"of-{digest[:8]}.ckpt")
    own = configured("task=test", f"ckpt_path={named}")
    assert own.paths.run == f"{weights}/of-{digest[:8]}"


@pytest.mark.parametrize(
    ("override", "name"),
    [
        ("seed=1", "custom"),
        ("+experiment=baseline", "baseline"),
        ("size.dim=16", "custom"),
    ],
)
def test_a_command_that_says_something_of_the_model_must_say_it_all(configured, override, name):
    with pytest.raises(UserError, match=f'name="skyocc".*"{name}"'):
        Session(configured("task=predict", override)).checkpoint("predict")


def test_it_is_asked_with_the_steps_that_it_has_learnt(trained):
    cfg = compose_config(*trained, "ckpt_path=best", "data.history_step_s=0.8")
    with pytest.raises(
        UserError, match=r"trained with data\.history_step_s=0\.4, and now it is 0\.8"
    ):
        Session(cfg).checkpoint("predict")


# ----------------------------------------------------------------------------- what is needed of it


@pytest.fixture
def labels_read(monkeypatch):
    """The frames whose labels were read."""
    read, semantics = set(), Clip.semantics

    def watched(self, frame):
        read.add((self.clip_id, frame))
        return semantics(self, frame)

    monkeypatch.setattr(Clip, "semantics", watched)
    monkeypatch.setattr(SkyShieldData, "labels", None)
    return read


def test_predict_and_attitude_read_no_training_label(configured, labels_read, tmp_path):
    cfg = configured("task=predict", f"predictions={tmp_path}/mine")
    predict(cfg, "test", logits=False, animation=f"{tmp_path}/flight.gif")
    attitude(cfg, **ATTITUDE)
    assert (tmp_path / "flight.gif").stat().st_size > 0
    data = SkyShieldData(root_of(cfg), seed=0, **{**cfg.data, "workers": 0})
    assert not labels_read & {*data.split["train"], *data.split["val"]}


def test_predict_works_without_the_training_clips_and_writes_nothing_else(configured, tmp_path):
    cfg = configured("task=predict", f"predictions={tmp_path}/mine")
    root = root_of(cfg)
    shutil.rmtree(root / "downtown")
    before = files_below(tmp_path)
    predict(cfg, "test", logits=False)
    written = {"mine/predictions.json", "mine/suburb/clip00/occupancy.npz"}
    assert files_below(tmp_path) - before == written
    shutil.rmtree(root / "suburb")
    with pytest.raises(UserError, match="task=generate"):
        predict(configured("task=predict", f"predictions={tmp_path}/other"), "test", logits=False)


def test_nothing_is_generated_where_there_is_no_dataset(configured, tmp_path):
    cfg = configured("task=predict", f"paths.data={tmp_path}/nowhere")
    for task in (lambda: predict(cfg, "test", logits=False), lambda: attitude(cfg, **ATTITUDE)):
        with pytest.raises(UserError, match=r"manifest\.json: not found"):
            task()
    assert not (tmp_path / "nowhere").exists()
    assert not (tmp_path / "runs").exists()


def test_export_needs_no_dataset_and_writes_nothing_else(configured, checkpoint, tmp_path):
    cfg = configured("task=export", f"paths.data={tmp_path}/nowhere")
    before = files_below(tmp_path)
    export(cfg, formats=["torch"], frames=5, tolerance=1e-3)
    assert not (tmp_path / "runs").exists(), "it goes to the run whose weights they are"
    folder = checkpoint.parent.parent / "export"
    assert {path.name for path in folder.iterdir()} == {DESCRIPTION, FORMATS["torch"]}
    assert files_below(tmp_path) == before
    assert not (tmp_path / "nowhere").exists()


def test_three_lines_of_the_docs_fly_it(checkpoint):
    """The first block of docs/model.md under its heading, with the checkpoint of this run."""
    text = (DOCS / "model.md").read_text().partition("## In flight")[2]
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    assert len([line for line in code.splitlines() if line]) == 3
    read = Checkpoint.read(checkpoint)
    (frame,) = made_up_flight(read.origin.config["sim"], 1, 0.2)
    names = frame._asdict()
    exec(re.sub(r'"runs/.*?ckpt"', repr(str(checkpoint)), code), names)
    expected = SkyOccStream(read.network(), 0.4)(frame)
    assert names["logits"].equal(expected)


# -------------------------------------------------------------------------------- what is refused


@pytest.fixture
def changed(checkpoint, tmp_path):
    """Reads a copy of the checkpoint in which something of its content is changed."""

    def read(change):
        content = torch.load(checkpoint, weights_only=True)
        change(content)
        torch.save(content, tmp_path / "some.ckpt")
        return Checkpoint.read(tmp_path / "some.ckpt")

    return read


def test_a_clip_that_was_trained_on_is_no_test(trained, checkpoint):
    seen = f"ckpt_path={checkpoint}", "data.test_clips=[downtown/clip00]", "data.val_clips=[]"
    with pytest.raises(UserError, match=r"data\.test_clips: .* was trained on downtown/clip00"):
        Session(compose_config(*trained, *seen)).checkpoint("test")


class Intruder:
    """Runs code of its own where a pickle of it is loaded."""

    def __reduce__(self):
        return Path.touch, (Path("intruder"),)


@pytest.mark.parametrize("read", [Checkpoint.read, read_encoder])
def test_no_code_in_a_checkpoint_is_run(read, changed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"some\.ckpt is no readable"):
        changed(lambda content: content.update(intruder=Intruder()))
    for other in (None, "frame,time_s\n1,0.5\n", "]"):
        if other is not None:
            (tmp_path / "some.ckpt").write_text(other)
        with pytest.raises(UserError, match=r"some\.ckpt is no readable"):
            read(tmp_path / "some.ckpt")
    assert not Path("intruder").exists()


def backbone_of(content):
    return content["skyshield"]["config"]["model"]["backbone"]


def test_it_needs_no_file_that_its_training_began_with(changed):
    read = changed(lambda content: backbone_of(content).update(weights="gone.pth"))
    assert not read.network().training


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content.pop("skyshield"), "is of format 1"),
        (lambda content: content["skyshield"].update(format=2), "is of format 2"),
        (lambda content: content["skyshield"].update(moons=2), "moons; use the code"),
        (
            lambda content: backbone_of(content).update(_target_="src.models.backbone.Gone"),
            r"cannot be built .*src\.models\.backbone\.Gone",
        ),
        (
            lambda content: content["state_dict"].pop("network.encoder.query"),
            r"another architecture .*encoder\.query first",
        ),
    ],
)
def test_a_checkpoint_of_another_format_or_architecture_is_one_line(changed, change, said):
    with pytest.raises(UserError, match=rf"^ckpt_path: .*some\.ckpt .*{said}") as info:
        changed(change).network()
    assert "\n" not in str(info.value)


def test_weights_whose_name_has_another_hash_are_refused(checkpoint, tmp_path):
    content = Path(checkpoint).read_bytes()
    digest = hashlib.sha256(content).hexdigest()[:8]
    (tmp_path / f"own-{digest}.ckpt").write_bytes(content)
    Checkpoint.read(tmp_path / f"own-{digest}.ckpt")
    (tmp_path / "own-01234567.ckpt").write_bytes(content)
    with pytest.raises(UserError, match=r"another hash than its name ends in; .* rename") as told:
        Checkpoint.read(tmp_path / "own-01234567.ckpt")
    assert "no readable" not in str(told.value), "the file is sound"


@pytest.mark.parametrize("share", [0, 0.5])
def test_a_checkpoint_cut_short_is_one_line_with_a_reason(checkpoint, tmp_path, share):
    content = Path(checkpoint).read_bytes()
    (tmp_path / "cut.ckpt").write_bytes(content[: int(share * len(content))])
    with pytest.raises(UserError, match=r"cut\.ckpt is no readable checkpoint \(\w.*\)") as info:
        Checkpoint.read(tmp_path / "cut.ckpt")
    assert "\n" not in str(info.value)
