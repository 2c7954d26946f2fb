"""The card of a dataset: its numbers are those of the files, and it can be written again."""

import re
import shutil

import numpy as np
import pandas as pd
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from src.data.dataset import history_stride
from src.data.manifest import MANIFEST, read_manifest
from src.errors import UserError
from src.report import animation
from src.tasks.dataset import spec_of
from studies.card import paper
from studies.card.page import overrides_of, write_card
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture
def text(root):
    return (root / "README.md").read_text()


def cells(text, first):
    """The other cells of the first row that starts with some words."""
    line = next(line for line in text.splitlines() if line.startswith(f"| {first} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_everything_is_there_and_nothing_temporary(root, text):
    made = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}
    pictures = ("card/statistics.png", "card/contact_sheet.jpg", "card/flight.gif")
    assert {"README.md", "croissant.json", "card/clips.csv", *pictures} <= made
    assert not [name for name in made if ".tmp" in name]
    assert {*pictures, "card/clips.csv"} == {*re.findall(r"\]\(([^)]+)\)", text)}
    for name in pictures:
        with Image.open(root / name) as picture:
            assert np.asarray(picture.convert("L")).std() > 20
    table = pd.read_csv(root / "card/clips.csv")
    assert table["clip"].tolist() == ["suburb/clip00", "suburb/clip01"]


def test_its_numbers_are_those_of_the_files_beside_the_paper_s(text, statistics):
    heights_m, cars = statistics.frames["altitude_m"], statistics.frames["visible/car"]
    below = 100 * (heights_m < 11).mean()
    expected = {
        "mean height": [f"{heights_m.mean():.2f} m", "7.18 m"],
        "frames below 11 m": [f"{below:.1f}%", "86.1%"],
        # Of the actors, which come before the classes.
        "car": [f"{cars.sum():,}", f"{cars.mean():.2f}", "2.07"],
        "Train / Val / Test": ["25 / 3 / 32", "29,000 / 3,200 / 3,800"],
        "test": ["32", "53.3%", "`suburb/clip01`"],
        "UAVDT": ["✓", "–", "–", "–", "1", "24,143", "0", "53,676"],
    }
    assert {name: cells(text, name)[: len(row)] for name, row in expected.items()} == expected
    assert cells(text, "car")[3:] == [f"{36_000 * cars.mean():,.0f}", "74,530"]
    assert cells(text, r"**this dataset**")[4:] == ["2", "25", "3", "32"]

    *shares, reported = cells(text, "free")
    assert [float(share.rstrip("%")) for share in shares] == pytest.approx(
        list(100 * statistics.class_shares().loc["free"]), rel=5e-3
    )
    of_paper = reported, cells(text, "thin structure")[-1], cells(text, "VRU")[-1]
    assert of_paper == ("82.78%", "0.26%", "0.016%")
    # Copied by hand: its table, its text and its split must tell the same.
    sizes = cells(text, r"SkyShield (the paper's)")[-3:]
    assert sum(int(number.replace(",", "")) for number in sizes) == paper.FRAMES
    assert sum(paper.INSTANCES.values()) == 218_280


def test_the_task_writes_it_again_with_the_pictures_of_the_simulator(
    root, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(animation, "SECONDS", 0.8)
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    write_card(root)
    assert {path: path.read_bytes() for path in before} == before
    copy = shutil.copytree(root, tmp_path / "data")
    cfg = compose_config("task=card", f"paths.dataset={copy}")
    instantiate(cfg.task)(cfg)
    text = (copy / "README.md").read_text()
    assert text.startswith("# SkyShield dataset `data`")
    assert "(card/pipeline.jpg)" in text
    assert "(card/weathers.jpg)" not in text
    assert (copy / "card/pipeline.jpg").is_file()
    assert "README.md" in capsys.readouterr().out


def test_an_unfinished_data_set_is_refused(mini_dataset, tmp_path):
    root = shutil.copytree(mini_dataset, tmp_path / "data")
    (root / MANIFEST).unlink()
    with pytest.raises(UserError, match=r"^[^\n]*task=generate[^\n]*$"):
        write_card(root)
    assert not (root / "README.md").exists()


@pytest.mark.parametrize(
    "settings",
    [
        ["sim.seed=7", "sim.weathers=[fog,night]"],
        ["sim.save_aux=true", "+sim.flight.min_altitude_m=3.5", "sim.camera.pitch_deg=10.0"],
        ["grid.shape=[50,50,30]", "sim.image.width=128", "sim.workers=1"],
    ],
)
def test_the_command_on_it_composes_to_the_same_digest(tmp_path, settings):
    made_with = compose_config(*mini_overrides(tmp_path, *settings))
    words = overrides_of(read_manifest(write_dataset(made_with)))
    cfg = compose_config(*words)
    assert spec_of(cfg).digest == spec_of(made_with).digest
    assert (cfg.scale_name, cfg.data.test_clips) == ("tiny", ["suburb/clip00"])
    assert OmegaConf.to_container(cfg.grid) == OmegaConf.to_container(made_with.grid)
    assert any(setting in words for setting in settings if not setting.startswith("+"))
    # The capture rate, which the default step of the history does not divide, is not refused.
    assert history_stride(cfg.data.history_step_s, cfg.sim.capture_hz) == 1
