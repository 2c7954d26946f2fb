"""The card of a dataset: its numbers are those of the files, and it can be written again."""

import re
import shutil

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
from studies.card import page, paper
from studies.card.page import overrides_of, write_card
from studies.card.statistics import Statistics, statistics_of
from tests.synthetic import compose_config, mini_overrides, write_clip, write_dataset


@pytest.fixture(scope="module", autouse=True)
def short_flight():
    """An animation of two frames: its own test makes the whole one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(animation, "SECONDS", 0.8)
        yield


@pytest.fixture(scope="module")
def root(mini_dataset, tmp_path_factory):
    """A copy of the small dataset with its card."""
    root = tmp_path_factory.mktemp("card") / mini_dataset.name
    shutil.copytree(mini_dataset, root)
    write_card(root)
    return root


@pytest.fixture(scope="module")
def text(root):
    return (root / "README.md").read_text()


def cells(text, first):
    """The other cells of the first row that starts with some words."""
    line = next(line for line in text.splitlines() if line.startswith(f"| {first} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_everything_is_there_and_nothing_temporary(root, text):
    made = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}
    names = ("statistics.png", "contact_sheet.jpg", "flight.gif", "clips.csv")
    assert {"README.md", "croissant.json", *(f"card/{name}" for name in names)} <= made
    assert not [name for name in made if ".tmp" in name]
    for target in re.findall(r"\]\(([^)]+)\)", text):
        assert (root / target).is_file()
    for name in names[:3]:
        with Image.open(root / "card" / name) as picture:
            picture.load()


def test_its_numbers_are_those_of_the_files(root, text):
    statistics = statistics_of(root)
    heights_m = statistics.frames["altitude_m"]
    assert cells(text, "mean height") == [f"{heights_m.mean():.2f} m", "7.18 m"]
    below = 100 * (heights_m < 11).mean()
    assert cells(text, "frames below 11 m") == [f"{below:.1f}%", "86.1%"]
    cars = statistics.frames["visible/car"]
    row = cells(text, "car")  # of the actors, which come before the classes
    assert row[:3] == [f"{cars.sum():,}", f"{cars.mean():.2f}", "2.07"]
    assert row[3:] == [f"{36_000 * cars.mean():,.0f}", "74,530"]
    assert cells(text, "Train / Val / Test") == ["25 / 3 / 32", "29,000 / 3,200 / 3,800"]
    assert cells(text, "test") == ["32", "53.3%", "`suburb/clip01`"]
    assert cells(text, r"**this dataset**")[4:] == ["2", "25", "3", "32"]
    assert cells(text, "UAVDT") == ["✓", "–", "–", "–", "1", "24,143", "0", "53,676"]


def test_shares_stand_beside_the_paper_s(root, text):
    shares = statistics_of(root).class_shares()
    row = cells(text, "free")
    assert row[-1] == "82.78%"
    for shown, share in zip(row, shares.loc["free"]):
        assert float(shown.rstrip("%")) == pytest.approx(100 * share, rel=5e-3)
    assert cells(text, "thin structure")[-1] == "0.26%"
    assert cells(text, "VRU")[-1] == "0.016%"


def test_the_table_of_clips_has_a_row_a_clip(root):
    table = pd.read_csv(root / "card/clips.csv")
    assert table["clip"].tolist() == ["suburb/clip00", "suburb/clip01"]
    assert table["frames"].tolist() == [30, 30]


def test_it_is_the_same_when_written_again(root):
    files = [path for path in root.rglob("*") if path.is_file()]
    before = {path: path.read_bytes() for path in files}
    write_card(root)
    assert {path: path.read_bytes() for path in files} == before


def test_pictures_of_the_simulator_are_shown_where_they_are(root, text, tmp_path):
    assert "pipeline.jpg" not in text
    copy = tmp_path / "data"
    shutil.copytree(root, copy)
    shutil.copy(root / "card/statistics.png", copy / "card/pipeline.jpg")
    write_card(copy)
    shown = (copy / "README.md").read_text()
    assert "(card/pipeline.jpg)" in shown
    assert "(card/weathers.jpg)" not in shown


def test_the_task_writes_it(root, tmp_path, capsys):
    copy = tmp_path / "data"
    shutil.copytree(root, copy)
    (copy / "README.md").unlink()
    cfg = compose_config("task=card", f"paths.dataset={copy}")
    instantiate(cfg.task)(cfg)
    assert (copy / "README.md").read_text().startswith("# SkyShield dataset `data`")
    assert (copy / "card/pipeline.jpg").is_file()
    assert "README.md" in capsys.readouterr().out


def test_an_unfinished_data_set_is_refused(mini_dataset, tmp_path):
    root = tmp_path / "data"
    shutil.copytree(mini_dataset, root)
    (root / MANIFEST).unlink()
    with pytest.raises(UserError, match="task=generate") as error:
        write_card(root)
    assert "\n" not in str(error.value)
    assert not (root / "README.md").exists()


def test_the_paper_s_numbers_agree_with_each_other(text):
    """Copied by hand: its table, its text and its split must tell the same."""
    of_paper = cells(text, r"SkyShield (the paper's)")[-3:]
    assert sum(int(number.replace(",", "")) for number in of_paper) == paper.FRAMES
    assert sum(paper.INSTANCES.values()) == 218_280


# ---------------------------------------------------------------- the command that stands on it


@pytest.mark.parametrize(
    "settings",
    [
        ["sim.seed=7", "sim.weathers=[fog,night]"],
        ["sim.save_aux=true", "+sim.flight.min_altitude_m=3.5", "sim.camera.pitch_deg=10.0"],
        ["grid.shape=[50,50,30]", "sim.image.width=128", "sim.workers=1"],
    ],
)
def test_the_command_composes_to_the_same_digest(tmp_path, settings):
    made_with = compose_config(*mini_overrides(tmp_path, *settings))
    words = overrides_of(read_manifest(write_dataset(made_with)))
    cfg = compose_config(*words)
    assert spec_of(cfg).digest == spec_of(made_with).digest
    assert (cfg.scale_name, cfg.data.test_clips) == ("tiny", ["suburb/clip00"])
    assert OmegaConf.to_container(cfg.grid) == OmegaConf.to_container(made_with.grid)
    assert any(setting in words for setting in settings if not setting.startswith("+"))
    # The capture rate, which the default step of the history does not divide, is not refused.
    assert history_stride(cfg.data.history_step_s, cfg.sim.capture_hz) == 1


def test_it_shows_the_liveliest_flight_of_the_first_weather(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(page, "draw_clip", lambda clip, *_: drawn.append(clip.clip_id))
    names = ["town/clip00", "town/clip01", "town/clip02"]
    for name in names:
        write_clip(tmp_path / name)
    clips = pd.DataFrame({"clip": names, "weather": ["clear", "night", "clear"]})
    frames = pd.concat([clips, clips[:1]])
    # The first clip has more actors in all, as it has more frames, but fewer in a frame.
    frames = frames.assign(**{"visible/car": [2, 9, 1, 2], "visible/bus": [0, 9, 2, 0]})
    page.draw_flight(tmp_path, Statistics(frames, clips), tmp_path / "flight.gif")
    assert drawn == ["town/clip02"]
