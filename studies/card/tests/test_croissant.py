"""The metadata against mlcroissant, which validates it and reads the files through it."""

import json
import sys

import mlcroissant as mlc
import pytest
from absl import logging as absl_logging

from src.data.clip import Clip
from src.data.files import sha256_of
from src.data.manifest import MANIFEST, read_manifest
from src.ontology import CLASSES
from studies.card.croissant import FILE_SETS, croissant_of

# absl, which mlcroissant brings, closes its stream when logging is configured anew: not pytest's.
absl_logging.get_absl_handler().python_handler.stream = sys.__stderr__


@pytest.fixture
def metadata(root):
    return json.loads((root / "croissant.json").read_text())


@pytest.fixture(scope="module")
def dataset(root):
    return mlc.Dataset(jsonld=str(root / "croissant.json"))


def test_it_is_valid_and_says_what_it_conforms_to(root, dataset, metadata):
    assert metadata["conformsTo"] == "http://mlcommons.org/croissant/1.0"
    assert isinstance(metadata["@context"], dict)
    assert metadata["name"] == root.name
    issues = dataset.metadata.ctx.issues
    assert not issues.errors
    # A dataset that everyone makes anew has no date of publication, and a stable card none at all.
    assert len(issues.warnings) == 1
    assert "datePublished" in next(iter(issues.warnings))


@pytest.mark.parametrize("record_set", ["frames", "actors"])
def test_tables_are_read_through_it(root, dataset, record_set):
    table = getattr(Clip(root / "suburb/clip00"), record_set)
    for record, row in zip(dataset.records(record_set), table.head(40).to_dict("records")):
        read = {name.partition("/")[2]: value for name, value in record.items()}
        read = {k: v.decode() if isinstance(v, bytes) else v for k, v in read.items()}
        assert read.pop("clip") == "suburb/clip00"
        # Its reader is pandas, of which version 2 (Python 3.10) reads fewer digits.
        close = {
            k: v if isinstance(v, str) else pytest.approx(v, rel=1e-12) for k, v in row.items()
        }
        assert read == close


def test_every_clip_and_every_class_is_listed(root, dataset):
    clips = [record["frames/clip"].decode() for record in dataset.records("frames")]
    assert clips == ["suburb/clip00"] * 30 + ["suburb/clip01"] * 30
    rows = list(dataset.records("clips"))
    assert [row["clips/role"].decode() for row in rows] == ["split", "test"]
    assert all(set(row) >= {"clips/bytes", "clips/mean_altitude_m"} for row in rows)
    listed = {row["classes/id"]: row["classes/name"] for row in dataset.records("classes")}
    assert listed == dict(enumerate(CLASSES))


def test_every_kind_of_file_is_described_and_none_that_is_not_there(root, metadata):
    patterns = [entry.get("includes") for entry in metadata["distribution"]]
    in_clip = {file.name for file in (root / "suburb/clip00").iterdir()}
    assert in_clip <= set(FILE_SETS)
    assert {f"*/*/{name}" for name in in_clip} <= set(patterns)

    manifest = read_manifest(root)
    for clip in manifest["clips"].values():
        del clip["files"]["aux.npz"]
    fewer = croissant_of(root, manifest, "A test.", root / "card/clips.csv")
    assert "*/*/aux.npz" not in [entry.get("includes") for entry in fewer["distribution"]]


def test_every_column_has_a_description_and_lengths_a_unit(metadata):
    fields = {field["@id"]: field for r in metadata["recordSet"] for field in r["field"]}
    assert all(field["description"] for field in fields.values())
    assert fields["frames/altitude_m"]["description"].endswith("(metres)")
    assert fields["actors/vx_mps"]["description"].endswith("(m/s)")


def test_the_manifest_is_covered_by_its_hash(root, metadata):
    """And by its own hashes, every file of every clip."""
    (listed,) = (entry for entry in metadata["distribution"] if entry["@id"] == MANIFEST)
    assert listed["sha256"] == sha256_of(root / MANIFEST)
    assert listed["contentSize"] == f"{(root / MANIFEST).stat().st_size} B"
