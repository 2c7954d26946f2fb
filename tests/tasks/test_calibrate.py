"""task=calibrate, and who uses what it writes: predictions, scores, streams."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from src.data.predictions import Predictions
from src.errors import UserError
from src.knowledge import SEEN
from src.models.checkpoint import Checkpoint
from src.models.export import DESCRIPTION
from src.models.stream import SkyOccStream
from src.tasks.calibrate import calibrate
from src.tasks.export import export
from src.tasks.predict import predict
from src.tasks.test import test as score
from tests.synthetic import compose_config


@pytest.fixture(scope="module")
def calibrated(trained):
    return calibrate(compose_config(*trained, "ckpt_path=best"), "distance", 200)


def test_it_leaves_the_weights_and_lowers_what_it_fits(calibrated, checkpoint):
    before, after = Checkpoint.read(checkpoint), Checkpoint.read(calibrated)
    assert all(torch.equal(each, after.state[name]) for name, each in before.state.items())
    assert after.origin.calibration["kind"] == "distance"

    table = pd.read_csv(calibrated.with_name("calibration.csv")).set_index(["part", "weights"])
    nll = table["nll"]
    assert nll["val", "calibrated"] < nll["val", "as trained"]
    assert table.index.tolist() == [
        (part, name) for part in ("val", "test") for name in ("as trained", "calibrated")
    ]
    assert calibrated.with_name("reliability.png").stat().st_size > 5000


def test_the_same_command_fits_the_same_numbers(calibrated, trained):
    again = calibrate(compose_config(*trained, "ckpt_path=best"), "distance", 200)
    assert again.read_bytes() == calibrated.read_bytes()


def test_a_network_is_calibrated_where_it_is_asked_for_alone(calibrated):
    network, other = (Checkpoint.read(calibrated).network(each) for each in (False, True))
    assert network.calibrator is None
    assert other.calibrator is not None
    assert SkyOccStream.of(calibrated, calibrated=True).network.calibrator is not None


def test_predictions_and_scores_are_those_of_the_calibrated_network(calibrated, trained, tmp_path):
    folders = [tmp_path / name for name in ("plain", "calibrated")]
    for folder in folders:
        words = f"ckpt_path={calibrated}", f"calibrated={str(folder == folders[1]).lower()}"
        cfg = compose_config(*trained, *words, f"predictions={folder}")
        predict(cfg, "test", logits=True, knowledge=True)
    path = next(folders[0].glob("*/*/logits.npz"))
    name = path.parent.relative_to(folders[0]).as_posix()
    with np.load(path) as archive:
        frame = int(archive.files[0].removeprefix("logits_"))

    plain, mapped = (Predictions(folder).logits(name, frame) for folder in folders)
    calibrator = Checkpoint.read(calibrated).network(calibrated=True).calibrator
    assert torch.allclose(calibrator(plain[None])[0], mapped, atol=0.05)
    assert not torch.allclose(plain, mapped, atol=0.05)
    with np.load(folders[1] / name / "knowledge.npz") as archive:
        assert (archive[f"knowledge_{frame:06d}"] == SEEN).any()

    cfg = compose_config(*trained, f"ckpt_path={calibrated}", "calibrated=true")
    score(cfg)
    assert (Path(cfg.paths.run) / "test-calibrated/results.csv").is_file()
    export(cfg, ["torch"], frames=5, tolerance=1e-3)
    description = Path(cfg.paths.run) / "export-calibrated" / DESCRIPTION
    assert json.loads(description.read_text())["calibrated"] is True


def test_what_has_no_calibration_and_what_cannot_have_one_is_refused(trained, tmp_path):
    cfg = compose_config(*trained, "ckpt_path=best", "calibrated=true", f"predictions={tmp_path}/p")
    with pytest.raises(UserError, match=r"^calibrated: .*best\.ckpt holds no calibration; run"):
        predict(cfg, "test", logits=False)
    with pytest.raises(UserError, match=r"^task\.kind: "):
        calibrate(compose_config(*trained, "ckpt_path=best"), "temprature", 200)
    with pytest.raises(UserError, match=r"^task\.voxels: "):
        calibrate(compose_config(*trained, "ckpt_path=best"), "vector", 0)
