"""The frames that a report shows, and what is seen there of two trained rungs."""

import re
import shutil

import numpy as np
import pytest
import torch
import yaml
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from src.data.clip import Clip
from src.ontology import CLASSES, FREE
from src.report.hard_cases import HardCase
from src.report.scene import TRUTH
from src.tasks.fit import fit
from src.tasks.session import Session
from src.tasks.showcase import _scene, _Viewer, ends_of, facts_of
from tests.results.scored import ladder_of, write_ladder
from tests.synthetic import compose_config, mini_overrides, write_dataset

RUNGS = ("baseline", "skyocc")


def ends(folder, **which):
    runs = ladder_of(write_ladder(folder, **which))
    return [str(run) for run in ends_of(runs)]


def test_the_lowest_and_the_highest_rung_of_the_lowest_seed_of_most_rungs_are_shown(tmp_path):
    assert ends(tmp_path / "a", seeds=(1, 0)) == ["baseline seed 0", "skyocc seed 0"]
    assert ends(tmp_path / "b", seeds=(0,), experiments=("streams",)) == [], "it is no rung"
    assert ends(tmp_path / "c", seeds=(0,), experiments=("weights",)) == ["weights seed 0"]
    # The sweep goes on with two rungs of another seed.
    of_other = {"seeds": (2,), "experiments": ("attitude", "baseline")}
    assert ends(tmp_path / "c", **of_other) == ["baseline seed 2", "attitude seed 2"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory):
    cfg = compose_config(*mini_overrides(tmp_path_factory.mktemp("frames")))
    write_dataset(cfg)
    return cfg


def every_other_slice(visible):
    return visible & (np.arange(len(visible)) % 2 > 0)[:, None, None]


def test_frames_are_chosen_by_their_tilt_and_by_what_the_camera_sees(cfg, monkeypatch):
    visible_of = Clip.visible
    # The made-up flights hide nothing of themselves.
    monkeypatch.setattr(Clip, "visible", lambda *frame: every_other_slice(visible_of(*frame)))
    data = Session(cfg).data

    facts = facts_of(data).set_index(["clip", "frame"])
    assert list(facts.index) == data.split["test"]
    for clip_id, frame in data.split["test"]:
        clip, row = data.clips[clip_id], facts.loc[(clip_id, frame)]
        semantics, visible = clip.semantics(frame), clip.visible(frame)
        for n, name in enumerate(CLASSES):
            assert row[name] == sum(semantics[visible] == n), name
        roll_rad, pitch_rad = clip.frames.loc[frame, ["roll_rad", "pitch_rad"]]
        assert row["tilt_rad"] == pytest.approx(abs(roll_rad) + abs(pitch_rad))
        assert (semantics[~visible] < FREE).any(), "what is hidden does not count"
    assert facts["tilt_rad"].nunique() > 2


class Watcher:
    """A network that remembers how many frames it was given."""

    device = torch.device("cpu")

    def __call__(self, batch):
        self.frames = batch["image"].shape[1]
        return torch.zeros(1, len(CLASSES), *batch["semantics"].shape[1:])


def test_each_network_sees_the_history_that_its_run_saw(cfg):
    viewers = []
    for frames in (1, 2):
        data = Session(OmegaConf.merge(cfg, {"data": {"frames": frames}})).data
        viewers.append(_Viewer(f"of {frames}", Watcher(), data.dataset("test")))
    case = HardCase("most tilted", *data.split["test"][0])
    scene = _scene(case, viewers, data.grid)
    assert [viewer.network.frames for viewer in viewers] == [1, 2]
    assert list(scene.predictions) == ["of 1", "of 2"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The words of two rungs, trained on the synthetic dataset."""
    folder = tmp_path_factory.mktemp("showcase")
    common = mini_overrides(folder, "trainer.accelerator=cpu", "trainer.max_epochs=1")
    words = {rung: [*common, f"+experiment={rung}"] for rung in RUNGS}
    write_dataset(compose_config(*words["baseline"]))
    for each in words.values():
        fit(compose_config(*each))
    return words


def report_of(trained, folder, **settings):
    """Makes a report of one scene in ``<folder>/out``, and returns the configuration."""
    cfg = compose_config(*trained["baseline"], "task=report", "task.scenes=1")
    instantiate(cfg.task, out=str(folder / "out"), **settings)(cfg)
    return cfg


@pytest.mark.slow
def test_a_report_shows_the_hardest_frame_as_both_rungs_see_it(trained, tmp_path):
    cfg = report_of(trained, tmp_path)
    page = (tmp_path / "out/report.html").read_text()
    (title,) = re.findall(r'"label":"1 of 1: (.*?)"', page)
    clip_id, frame = re.match(
        r"(\S+) frame (\d+) .* most tilted", title.replace("\\u002f", "/")
    ).groups()
    for name in (TRUTH, "Baseline", "SkyOcc"):
        assert f'"text":"{name}"' in page
    facts = facts_of(Session(cfg).data).set_index(["clip", "frame"])["tilt_rad"]
    assert facts[clip_id, int(frame)] == facts.max() > 0.15

    for name in ("comparison.jpg", "tilt.jpg"):
        with Image.open(tmp_path / "out/figures" / name) as figure:
            assert np.ptp(np.asarray(figure)) > 100


@pytest.mark.slow
def test_data_settings_of_other_code_leave_the_pictures_out(trained, tmp_path):
    runs = shutil.copytree(compose_config(*trained["baseline"]).paths.runs, tmp_path / "runs")
    for path in runs.rglob("config.yaml"):
        config = yaml.safe_load(path.read_text())
        del config["data"]["run_frames"]
        path.write_text(yaml.safe_dump(config))
    report_of(trained, tmp_path, runs=[str(runs)])
    assert "data are those of other code" in (tmp_path / "out/report.md").read_text()
    assert (tmp_path / "out/report.html").is_file()
