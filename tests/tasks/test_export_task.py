"""task=export on a trained checkpoint, as a user calls it."""

from pathlib import Path

import pytest

from src.errors import UserError
from src.models.export import DESCRIPTION, FORMATS
from src.tasks.export import export
from src.tasks.fit import fit
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture(scope="module")
def overrides(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    overrides = mini_overrides(folder, "+experiment=skyocc", "trainer.accelerator=cpu")
    write_dataset(compose_config(*overrides))
    fit(compose_config(*overrides, "trainer.max_epochs=1"))
    return [*overrides, "trainer.max_epochs=1"]


@pytest.mark.slow
def test_it_writes_the_graphs_beside_the_run_and_says_how_near_they_are(overrides, capsys):
    cfg = compose_config(*overrides, "ckpt_path=best")
    export(cfg, formats=["onnx", "torch"], frames=5, tolerance=1e-3)
    folder = f"{cfg.paths.run}/export"
    output = capsys.readouterr().out

    assert "5 frames" in output
    assert folder in output.replace("\n", "")
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, *FORMATS.values()}
    before = (Path(folder) / DESCRIPTION).read_bytes()
    with pytest.raises(UserError, match=r"task\.tolerance=-1"):
        export(cfg, formats=["torch"], frames=6, tolerance=-1.0)
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, *FORMATS.values()}
    assert (Path(folder) / DESCRIPTION).read_bytes() == before
    export(cfg, formats=["torch"], frames=5, tolerance=1e-3)
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, FORMATS["torch"]}, (
        "no graph of an earlier export stays beside it"
    )


@pytest.mark.slow
def test_what_cannot_be_exported_is_refused(overrides):
    with pytest.raises(UserError, match="ckpt_path: task=export"):
        export(compose_config(*overrides), formats=["onnx"], frames=5, tolerance=1e-3)
    cfg = compose_config(*overrides, "ckpt_path=best")
    level = compose_config(*overrides, "ckpt_path=best", "model/projection=level")
    for nothing in ({"formats": [], "frames": 5}, {"formats": ["onnx"], "frames": 0}):
        with pytest.raises(UserError, match=r"task\.(formats: empty|frames: 0)"):
            export(cfg, **nothing, tolerance=1e-3)
    with pytest.raises(UserError, match=r'projection="attitude".*"level"'):
        export(level, formats=["onnx"], frames=5, tolerance=1e-3)
