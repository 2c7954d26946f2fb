"""task=export on a trained checkpoint, as a user calls it."""

import json
from pathlib import Path

import pytest

from src.errors import UserError
from src.models.export import DESCRIPTION, FORMATS
from src.tasks.export import export
from tests.synthetic import compose_config


@pytest.mark.slow
def test_it_writes_the_graphs_beside_the_run_and_says_how_near_they_are(trained, capsys):
    cfg = compose_config(*trained, "ckpt_path=best")
    export(cfg, formats=["onnx", "torch"], frames=5, tolerance=1e-3)
    folder = Path(cfg.paths.run) / "export"
    output = capsys.readouterr().out
    assert "5 frames" in output
    assert str(folder) in output.replace("\n", "")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert set(before) == {DESCRIPTION, *FORMATS.values()}

    with pytest.raises(UserError, match=r"task\.tolerance=-1"):
        export(cfg, formats=["torch"], frames=6, tolerance=-1.0)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    export(cfg, formats=["torch"], frames=5, tolerance=1e-3)
    left = {path.name for path in folder.iterdir()}
    assert left == {DESCRIPTION, FORMATS["torch"]}, "no graph of an earlier export stays beside it"
    assert json.loads((folder / DESCRIPTION).read_text())["calibrated"] is False


@pytest.mark.slow
def test_what_cannot_be_exported_is_refused(trained):
    with pytest.raises(UserError, match="ckpt_path: task=export"):
        export(compose_config(*trained), formats=["onnx"], frames=5, tolerance=1e-3)
    cfg = compose_config(*trained, "ckpt_path=best")
    for nothing in ({"formats": [], "frames": 5}, {"formats": ["onnx"], "frames": 0}):
        with pytest.raises(UserError, match=r"task\.(formats: empty|frames: 0)"):
            export(cfg, **nothing, tolerance=1e-3)
