"""`docs/extending.md`, executed: its files are written to a folder of one's own, and used."""

import importlib
import re
import shlex
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from src.sim.air import apply_weather
from src.sim.layout import Town
from src.sim.towns import build_town, town_names
from src.sim.weather import Weather
from src.sim.world import Rendering
from src.tasks.generate import generate
from src.tasks.session import data_of
from tests.synthetic import mini_overrides, sound_config, untrained, write_dataset

PAGE = (Path(__file__).parents[1] / "docs/extending.md").read_text(encoding="utf-8")
SECTIONS = dict(part.split("\n", 1) for part in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:])
ADDED = ("A loss", "Class weights", "A metric", "A weather", "A town")
FILE = re.compile(r"^`(\S+)`:\n\n```(?:python|yaml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^python run\.py (.*?)$", re.MULTILINE)


def files_of(section):
    """The files that a section of the page adds, by their paths."""
    return dict(FILE.findall(SECTIONS[section]))


def lines_of(text):
    """Lines that are neither blank nor a comment."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


@pytest.fixture
def added(request, tmp_path, monkeypatch):
    """Writes the files of a section, as the page has them, where the program finds them.

    Returns a function that composes and checks a configuration beside them.
    """
    (tmp_path / "conf").mkdir()
    for path, text in files_of(request.param).items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
        if path.endswith(".py"):
            name = path.removesuffix(".py").replace("/", ".")
            package = importlib.import_module(name.rpartition(".")[0])
            folders = [*package.__path__, str((tmp_path / path).parent)]
            monkeypatch.setattr(package, "__path__", folders)
            monkeypatch.delitem(sys.modules, name, raising=False)
            monkeypatch.delattr(package, name.rpartition(".")[2], raising=False)

    yield partial(sound_config, folder=tmp_path / "conf")
    for path in files_of(request.param):
        sys.modules.pop(path.removesuffix(".py").replace("/", "."), None)


@pytest.mark.parametrize("section", ADDED)
def test_each_is_one_file_and_a_few_lines_of_configuration(section):
    files = files_of(section)
    code = [path for path in files if path.endswith(".py")]
    settings = [line for path in files if path.endswith(".yaml") for line in lines_of(files[path])]
    assert len(code) <= 1
    assert len(settings) <= 5
    assert sum(len(lines_of(text)) for text in files.values()) < 30


@pytest.mark.parametrize("added", ADDED, indirect=True, ids=str)
def test_every_command_of_the_page_is_sound(added, request):
    section = request.node.callspec.params["added"]
    commands = COMMAND.findall(SECTIONS[section])
    assert commands
    for command in commands:
        added(*shlex.split(command, comments=True))


@pytest.mark.parametrize("added", ["A loss"], indirect=True, ids=str)
def test_a_loss_is_trained_with(added, tmp_path):
    cfg = added("+experiment=dice", *mini_overrides(tmp_path, "data.frames=1"))
    module = untrained(cfg, data := data_of(cfg, write_dataset(cfg)))
    batch = next(iter(data.train_dataloader()))
    values = module.loss(module(batch), batch["semantics"])
    values["total"].backward()

    assert set(values) == {"cross_entropy", "lovasz", "dice", "total"}
    assert 0 < values["dice"] < 1
    assert values["dice"].requires_grad
    total = values["cross_entropy"] + values["lovasz"] + 0.5 * values["dice"]
    torch.testing.assert_close(values["total"], total)


@pytest.mark.parametrize("added", ["A metric"], indirect=True, ids=str)
def test_a_metric_scores_beside_the_others(added, tmp_path):
    cfg = added("+experiment=missed", *mini_overrides(tmp_path, "data.frames=1"))
    module = untrained(cfg, data := data_of(cfg, write_dataset(cfg)))
    batch = next(iter(data.test_dataloader()))
    module.test_step(batch, 0)

    occupied = batch["semantics"] < 8
    preds = module(batch).argmax(dim=1)
    scores = module.test_suite.scores()
    expected = (preds[occupied] == 8).double().mean().item()
    assert scores["missed"] == pytest.approx(expected)
    assert {"miou", "kar_miou"} <= scores.keys()


@pytest.mark.parametrize("added", ["A weather"], indirect=True, ids=str)
def test_a_weather_is_planned_and_painted(added, tmp_path, capsys):
    cfg = added("scale=tiny", "sim.weathers=[clear,dust]", "sim.dry_run=true")
    generate(cfg)
    assert re.search(r"^ +clear +dust", capsys.readouterr().out, re.MULTILINE)

    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    far = np.full((32, 48), 40.0, dtype=np.float32)
    grey = np.full((32, 48, 3), 100, dtype=np.uint8)
    rendering = Rendering(grey, far, np.zeros((32, 48), np.uint8), np.zeros((32, 48), np.int32))
    matrices = torch.eye(4), torch.eye(3)
    red, green, blue = (
        apply_weather(rendering, *matrices, Weather.of(sim, "dust"), np.random.default_rng(0))
        .mean(axis=(0, 1))
        .tolist()
    )
    assert red > green > blue


@pytest.mark.parametrize("added", ["A town"], indirect=True, ids=str)
def test_a_town_is_built_and_planned(added, capsys):
    assert "triangle" in town_names()
    town = build_town("triangle", np.random.default_rng(0))
    assert isinstance(town, Town)
    assert len(town.corridors) >= 3

    towns = ("sim.towns=[downtown,triangle]", "data.test_clips=[triangle/clip01]")
    generate(added("scale=tiny", "sim.dry_run=true", *towns))
    assert re.search(r"^triangle +\d", capsys.readouterr().out, re.MULTILINE)
