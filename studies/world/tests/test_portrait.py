"""Portraits: that they show what they say, and keep to their size."""

import numpy as np
import pytest
from PIL import Image

from src.ontology import BUILDING, CAR, SKY
from src.report.canvas import GAP_PIX, TITLE_PIX, titled_sheet, write_picture
from src.sim.plan import plan_clips
from studies.world.pipeline import draw_pipeline
from studies.world.portraits import portraits
from studies.world.shot import aerial_shot, entropy, photograph, street_shot
from tests.synthetic import compose_config


def test_entropy_is_that_of_equal_shares():
    classes = np.full((4, 4), BUILDING, np.uint8)
    assert entropy(classes) == 0
    classes[:2] = CAR
    assert entropy(classes) == pytest.approx(np.log(2))
    classes[0], classes[2] = SKY, SKY
    assert entropy(classes) == pytest.approx(-(0.5 * np.log(0.5) + 2 * 0.25 * np.log(0.25)))


def test_a_sheet_places_its_pictures_and_keeps_to_its_bytes(tmp_path):
    rng = np.random.default_rng(0)
    colors = [(250, 20, 20), (20, 250, 20), (20, 20, 250), (90, 90, 90)]
    flat = [np.full((40, 60, 3), color, np.uint8) for color in colors]
    rows = [[("a", flat[0]), ("b", flat[1])], [("c", flat[2]), ("d", flat[3])]]
    write_picture(titled_sheet(rows, 90).drawn(), tmp_path / "sheet.jpg", 100_000)
    sheet = np.asarray(Image.open(tmp_path / "sheet.jpg")).astype(int)
    assert sheet.shape == (2 * (60 + TITLE_PIX) + GAP_PIX, 3 * GAP_PIX + 2 * 90, 3)

    for n, color in enumerate(colors):
        v = TITLE_PIX + 30 + (n // 2) * (60 + TITLE_PIX)
        u = GAP_PIX + 45 + (n % 2) * (90 + GAP_PIX)
        assert np.abs(sheet[v, u] - color).max() < 12
    noise = [[("noise", rng.integers(0, 256, (300, 400, 3), dtype=np.uint8))]]
    write_picture(titled_sheet(noise, 400).drawn(), tmp_path / "noise.jpg", 70_000)
    assert (tmp_path / "noise.jpg").stat().st_size <= 70_000


@pytest.mark.slow
def test_a_town_is_seen_whole_and_from_the_street(mini_sim):
    aerial, street = aerial_shot(mini_sim, "suburb"), street_shot(mini_sim, "suburb")
    from_above = photograph(aerial, ["clear"], mini_sim)["clear"]
    pictures = photograph(street, ["clear", "night"], mini_sim)
    assert from_above.shape == pictures["clear"].shape == (544, 960, 3)
    assert pictures["night"].mean() < 0.5 * pictures["clear"].mean()
    np.testing.assert_array_equal(
        photograph(street, ["night"], mini_sim)["night"], pictures["night"]
    )


@pytest.mark.slow
def test_the_pipeline_has_ten_steps(mini_sim, tmp_path):
    draw_pipeline(mini_sim, plan_clips(mini_sim)[0], tmp_path / "pipeline.jpg")
    sheet = np.asarray(Image.open(tmp_path / "pipeline.jpg")).astype(int)
    cells = [part for row in np.array_split(sheet, 2) for part in np.array_split(row, 5, axis=1)]
    assert all(cell.std() > 10 for cell in cells)


@pytest.mark.slow
def test_the_task_writes_a_picture_of_every_town(tmp_path):
    words = ["scale=tiny", "sim.towns=[suburb]", "sim.weathers=[clear,fog]", "sim.capture_hz=2.5"]
    cfg = compose_config(*words, "sim.clips_per_town=1", "data.test_clips=[]")
    portraits(cfg, str(tmp_path))
    names = ("towns/suburb.jpg", "weathers.jpg", "pipeline.jpg")
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.jpg")} == set(names)
    assert (tmp_path / "towns/suburb.jpg").stat().st_size <= 150_000
