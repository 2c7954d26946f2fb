"""The depth of the pixels by class, and where there is texture."""

from pathlib import Path

import pandas as pd
import pytest
import torch

from src.ontology import CLASSES, FREE
from studies.motion.depth import main, textured
from tests.synthetic import compose_config


def test_what_is_smooth_has_no_texture():
    image = torch.full((1, 2, 3, 32, 64), 128, dtype=torch.uint8)
    image[0, -1, :, :, 32:] += 20 * torch.randint(0, 2, (32, 32), dtype=torch.uint8)
    found = textured({"image": image})
    assert found.shape == (1, 8, 16)
    assert not found[..., :7].any()
    assert found[..., 9:].all()


@pytest.mark.slow
def test_every_class_of_a_run_has_its_row(trained, tmp_path):
    run = Path(compose_config(*trained).paths.run)
    main(run, out=tmp_path / "depth.csv")
    table = pd.read_csv(tmp_path / "depth.csv").set_index("class")
    assert list(table.index) == [*CLASSES[:FREE], "all"]
    assert set(table["run"]) == {"tiny/skyocc/seed0"}
    assert table["pixels"].iloc[:-1].sum() == table.loc["all", "pixels"] > 0
    assert 0 < table.loc["all", "median_percent"] < 1000
