"""Where a dataset lies, and what it was made from."""

import json
import shutil

import pytest

from src.data.clip import SUMS
from src.data.files import sha256_of
from src.data.manifest import (
    MANIFEST,
    NOT_SHAPING,
    DatasetSpec,
    missing_clips,
    read_manifest,
    require_same_data,
    write_manifest,
)
from src.data.split import make_split
from src.errors import UserError
from src.used_code import SOURCE


def test_every_setting_that_shapes_the_data_changes_the_folder(mini_sim, tmp_path):
    spec = DatasetSpec.of("mini", mini_sim)
    digests = {spec.digest}
    for key, value in mini_sim.items():
        if key in ("workers", "dry_run"):
            continue
        other = {"seed": 1, "save_aux": False, "weather": {"clear": {}}}.get(
            key, [value, "changed"]
        )
        digests.add(DatasetSpec.of("mini", mini_sim | {key: other}).digest)
    deeper = mini_sim | {"image": mini_sim["image"] | {"hfov_deg": 91.0}}
    digests.add(DatasetSpec.of("mini", deeper).digest)
    assert len(digests) == 1 + len(mini_sim) - len(NOT_SHAPING) + 1
    assert spec.root(tmp_path) == tmp_path / f"mini-{spec.digest}"


def test_what_changes_no_byte_changes_no_name(mini_sim):
    spec = DatasetSpec.of("mini", mini_sim)
    how = {"workers": 7, "dry_run": True, "shards": 4, "shard": 3}
    assert DatasetSpec.of("mini", mini_sim | how) == spec
    rate = DatasetSpec.of("mini", mini_sim | {"capture_hz": 5})
    assert DatasetSpec.of("mini", mini_sim | {"capture_hz": 5.0}).digest == rate.digest
    backwards = dict(reversed(mini_sim.items()))
    assert DatasetSpec.of("mini", backwards).digest == spec.digest


@pytest.fixture
def code(tmp_path, monkeypatch):
    """A copy of the generator's code that may be edited."""
    copy = tmp_path / "src"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr("src.used_code.SOURCE", copy)
    return copy


def test_code_changes_the_folder_and_comments_do_not(mini_sim, code):
    before = DatasetSpec.of("mini", mini_sim).digest
    kernels = code / "sim/voxel_kernels.py"
    text = kernels.read_text()
    kernels.write_text(text.replace('"""The two loops', '"""Both loops') + "\n# A comment.\n")
    assert DatasetSpec.of("mini", mini_sim).digest == before
    kernels.write_text(text.replace("= 1\n", "= 2\n", 1))
    assert DatasetSpec.of("mini", mini_sim).digest != before
    kernels.write_text(text)
    (code / "models/losses.py").write_text("x = 1\n")
    assert DatasetSpec.of("mini", mini_sim).digest == before


def test_a_town_of_ones_own_counts_where_it_is_used(mini_sim, tmp_path, monkeypatch):
    """Its comments do not, and neither does the dotted name of a town of this project."""
    monkeypatch.syspath_prepend(tmp_path)
    town = tmp_path / "towns_of_mine/harbour.py"
    town.parent.mkdir()
    (town.parent / "__init__.py").write_text("")

    def spec_with(text, *towns):
        town.write_text(text)
        return DatasetSpec.of("mini", mini_sim | {"towns": ["suburb", *towns]})

    one, other = "LAMPS = 3\n", "LAMPS = 4\n"
    assert spec_with(one).generator == spec_with(other).generator
    before = spec_with(one, "towns_of_mine.harbour")
    assert spec_with(f"# Lit.\n{one}", "towns_of_mine.harbour").digest == before.digest
    assert spec_with(other, "towns_of_mine.harbour").digest != before.digest
    for name in ("src.sim.towns.suburb", "gone.harbour"):
        assert spec_with(one, name).generator == spec_with(one).generator


def test_the_manifest_holds_the_settings_and_every_hash(mini_dataset, mini_sim):
    manifest = read_manifest(mini_dataset)
    assert manifest["sim"]["seed"] == 0
    assert manifest["sim"]["renderer"] == "tiny"
    assert "workers" not in manifest["sim"]
    assert {"numpy", "torch"} < set(manifest["packages"])
    # Which of two packages has the engine depends on Python.
    assert {"pybullet", "pybullet-arm64"} & set(manifest["packages"])
    assert manifest["split"] == {"train": 25, "val": 3, "test": 32}
    assert manifest["held_out"] == {"val": [], "test": ["suburb/clip01"]}
    assert list(manifest["clips"]) == ["suburb/clip00", "suburb/clip01"]
    for clip_id, listed in manifest["clips"].items():
        assert listed["sha256"] == sha256_of(mini_dataset / clip_id / SUMS)
        for name, digest in listed["files"].items():
            assert digest == sha256_of(mini_dataset / clip_id / name)


def test_writing_it_again_changes_no_byte(mini_dataset, mini_sim, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(mini_dataset, root)
    before = (root / MANIFEST).read_bytes()
    clips = list(read_manifest(root)["clips"])
    split = make_split(clips, 30, mini_sim["capture_hz"], [], clips[-1:])
    write_manifest(root, DatasetSpec.of("mini", mini_sim), clips, split)
    assert (root / MANIFEST).read_bytes() == before


def test_missing_clips_are_those_without_a_folder(mini_dataset):
    wanted = ["suburb/clip00", "suburb/clip07", "park/clip00"]
    assert missing_clips(mini_dataset, wanted) == wanted[1:]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, r"sim\.seed=0.*asks for 1; set sim\.seed"),
        ({"capture_hz": 5}, r"sim\.capture_hz=2\.5.*asks for 5"),
        ({"novel": 1}, r"sim\.novel=null.*asks for 1"),
    ],
)
def test_other_data_are_refused_by_the_key_that_differs(mini_dataset, mini_sim, change, message):
    require_same_data(mini_dataset, DatasetSpec.of("mini", mini_sim | {"workers": 5}))
    with pytest.raises(UserError, match=message) as error:
        require_same_data(mini_dataset, DatasetSpec.of("mini", mini_sim | change))
    assert str(mini_dataset) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", [None, "", "{", "[]", "3", json.dumps({"sim": {}})])
def test_a_manifest_that_cannot_be_used_is_named(tmp_path, text):
    if text is not None:
        (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(UserError, match=rf"{MANIFEST}.*task=generate") as error:
        read_manifest(tmp_path)
    assert "\n" not in str(error.value)
