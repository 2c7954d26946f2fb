"""Where a dataset lies, and what it was made from."""

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


def test_a_town_of_ones_own_counts_where_it_is_used_and_those_of_this_project_by_any_name(
    mini_sim, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "harbours").mkdir()
    (tmp_path / "harbours/__init__.py").write_text("")

    def generator(lamps, *towns):
        (tmp_path / "harbours/harbour.py").write_text(f"LAMPS = {lamps}\n")
        return DatasetSpec.of("mini", mini_sim | {"towns": ["suburb", *towns]}).generator

    assert generator(3, "harbours.harbour") != generator(4, "harbours.harbour")
    for name in ("src.sim.towns.suburb", "gone.harbour"):
        assert generator(3, name) == generator(4)


def test_the_manifest_holds_the_settings_and_every_hash_whenever_it_is_written(
    mini_dataset, mini_sim, tmp_path
):
    manifest = read_manifest(mini_dataset)
    assert manifest["sim"] == DatasetSpec.of("mini", mini_sim).sim
    assert {"numpy", "torch"} < set(manifest["packages"])
    assert manifest["split"] == {"train": 25, "val": 3, "test": 32}
    assert manifest["held_out"] == {"val": [], "test": ["suburb/clip01"]}
    assert list(manifest["clips"]) == ["suburb/clip00", "suburb/clip01"]
    for clip_id, listed in manifest["clips"].items():
        assert listed["sha256"] == sha256_of(mini_dataset / clip_id / SUMS)
        for name, digest in listed["files"].items():
            assert digest == sha256_of(mini_dataset / clip_id / name)

    root, clips = shutil.copytree(mini_dataset, tmp_path / "copy"), list(manifest["clips"])
    split = make_split(clips, 30, mini_sim["capture_hz"], [], clips[-1:])
    write_manifest(root, DatasetSpec.of("mini", mini_sim), clips, split)
    assert (root / MANIFEST).read_bytes() == (mini_dataset / MANIFEST).read_bytes()
    wanted = ["suburb/clip00", "suburb/clip07", "park/clip00"]
    assert missing_clips(root, wanted) == wanted[1:]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, r"sim\.seed=0.*asks for 1; set sim\.seed"),
        ({"novel": 1}, r"sim\.novel=null.*asks for 1"),
    ],
)
def test_other_data_are_refused_by_the_key_that_differs(mini_dataset, mini_sim, change, message):
    require_same_data(mini_dataset, DatasetSpec.of("mini", mini_sim | {"workers": 5}))
    with pytest.raises(UserError, match=rf"^{mini_dataset}[^\n]*{message}[^\n]*$"):
        require_same_data(mini_dataset, DatasetSpec.of("mini", mini_sim | change))


@pytest.mark.parametrize("text", [None, "", "[]", "3", '{"sim": {}}'])
def test_a_manifest_that_cannot_be_used_is_named(tmp_path, text):
    if text is not None:
        (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(UserError, match=rf"^[^\n]*{MANIFEST}[^\n]*task=generate[^\n]*$"):
        read_manifest(tmp_path)
