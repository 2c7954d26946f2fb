"""task=audit as its user meets it: a table of the whole dataset, or one line of refusal."""

import json
import shutil

import pandas as pd
import pytest

from src.data.manifest import MANIFEST, read_manifest, sealed
from src.errors import UserError
from src.tasks.dataset import root_of
from studies.world.audit import audit
from tests.synthetic import generated_config


@pytest.fixture
def config(mini_dataset, tmp_path):
    """The configuration of a copy of the small dataset."""
    config = generated_config(tmp_path / "data")
    shutil.copytree(mini_dataset, root_of(config))
    return config


@pytest.mark.slow
def test_the_labels_are_scored_against_the_scenes(config, tmp_path, capsys):
    audit(config, frames_per_clip=2, out=str(tmp_path / "out"))
    table = pd.read_csv(tmp_path / "out/audit.csv").set_index(["scope", "class"])
    visible = table.loc["visible", "all"]
    assert visible["true"] > 200
    assert visible["recall"] > 0.85
    assert visible["precision"] > 0.97
    assert visible["free_error"] < 0.02
    assert table.loc["supervised", "all"]["labelled"] > visible["labelled"]
    text = (tmp_path / "out/audit.md").read_text()
    assert "4 frames of" in text
    assert "Ghosts of moving classes" in text
    assert "audit.md" in "".join(capsys.readouterr().out.split())


def test_what_cannot_be_audited_is_refused(config, tmp_path):
    with pytest.raises(UserError, match=r"task\.frames_per_clip: 0"):
        audit(config, frames_per_clip=0, out=None)

    root = root_of(config)
    shutil.rmtree(root / "suburb/clip01")
    with pytest.raises(UserError, match="task=generate"):
        audit(config, frames_per_clip=1, out=None)

    manifest = read_manifest(root) | {"generator": "another"}
    (root / MANIFEST).write_text(json.dumps(sealed(manifest)))
    with pytest.raises(UserError, match="generator another"):
        audit(config, frames_per_clip=1, out=None)
    (root / MANIFEST).unlink()
    with pytest.raises(UserError, match=MANIFEST):
        audit(config, frames_per_clip=1, out=None)
    assert not (root / "audit").exists()
