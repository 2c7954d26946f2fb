"""task=export on a trained checkpoint, as a user calls it."""

from pathlib import Path

import pytest

from src.errors import UserError
from src.models.export import DESCRIPTION, FORMATS
from src.tasks.export import export
from src.tasks.fit import fit
from tests.synthetic import compose_config, mini_overrides, write_dataset


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    words = mini_overrides(folder, "+experiment=skyocc", "trainer.accelerator=cpu")
    write_dataset(compose_config(*words))
    fit(compose_config(*words, "trainer.max_epochs=1"))
    return [*words, "trainer.max_epochs=1"]


@pytest.mark.slow
def test_it_writes_the_graphs_beside_the_run_and_says_how_near_they_are(words, capsys):
    cfg = compose_config(*words, "ckpt_path=best")
    export(cfg, formats=["onnx", "torch"], frames=5, tolerance=1e-3)
    folder = f"{cfg.paths.run}/export"
    said = capsys.readouterr().out
    assert "5 frames of a stream" in said
    assert folder in said.replace("\n", "")
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, *FORMATS.values()}
    before = (Path(folder) / DESCRIPTION).read_bytes()
    with pytest.raises(UserError, match=r"differ from the model's by .* it is not kept"):
        export(cfg, formats=["torch"], frames=6, tolerance=-1.0)
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, *FORMATS.values()}
    assert (Path(folder) / DESCRIPTION).read_bytes() == before
    export(cfg, formats=["torch"], frames=5, tolerance=1e-3)
    assert {path.name for path in Path(folder).iterdir()} == {DESCRIPTION, FORMATS["torch"]}, (
        "no graph of an earlier export stays beside it"
    )


@pytest.mark.slow
def test_what_cannot_be_exported_is_refused(words):
    with pytest.raises(UserError, match="ckpt_path: task=export needs a checkpoint"):
        export(compose_config(*words), formats=["onnx"], frames=5, tolerance=1e-3)
    cfg = compose_config(*words, "ckpt_path=best")
    level = compose_config(*words, "ckpt_path=best", "model/projection=level")
    for nothing in ({"formats": [], "frames": 5}, {"formats": ["onnx"], "frames": 0}):
        with pytest.raises(UserError, match=r"task\.(formats: empty|frames: 0)"):
            export(cfg, **nothing, tolerance=1e-3)
    other = r'projection="attitude", and now it is "level"; give the old value, or another ckpt_pat'
    with pytest.raises(UserError, match=other):
        export(level, formats=["onnx"], frames=5, tolerance=1e-3)
