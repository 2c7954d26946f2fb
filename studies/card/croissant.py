"""Croissant 1.0 metadata of a dataset: JSON-LD that tools of the field read and load.

The format is MLCommons' (http://mlcommons.org/croissant/1.0). Its context stands in the file, so
that reading it needs no network.
"""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import yaml

from src.data.clip import ACTOR_COLUMNS, FRAME_COLUMNS, SUMS
from src.data.files import sha256_of
from src.data.manifest import MANIFEST
from src.ontology import ACTOR_TYPES, CLASSES

WORDS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
# The files of a clip: how each is written, and what is in it.
FILE_SETS = WORDS["files"]

# Type and meaning of every column. What the ontology lists is not written down a second time.
COLUMNS = {
    **WORDS["columns"],
    "type": ["sc:Text", f"one of {', '.join(ACTOR_TYPES)}"],
    **{f"share_{n}": ["sc:Float", f"share of {n} among the labelled voxels"] for n in CLASSES},
}
for _actor in ACTOR_TYPES:
    COLUMNS[f"visible_{_actor}"] = ["sc:Integer", f"visible actors, {_actor}, summed over frames"]


def croissant_of(root: Path, manifest: Mapping, description: str, clips_csv: Path) -> dict:
    """Returns the metadata as plain data, to be written to ``<root>/croissant.json``.

    ``clips_csv`` is a table with a row a clip, somewhere under ``root``. Every clip's files are
    covered by the manifest's hashes, and the manifest by its own here.
    """
    # All clips of a dataset have the same files.
    files = next(iter(manifest["clips"].values()))["files"]

    return {
        **WORDS["dataset"],
        "@context": WORDS["context"],
        "name": root.name,
        "description": description,
        "distribution": [
            _file_object(root, root / MANIFEST, "application/json"),
            _file_object(root, clips_csv, "text/csv"),
            *(_file_set(name) for name in FILE_SETS if name in files or name == SUMS),
            _node("FileSet", "images", **WORDS["images"]),
        ],
        "recordSet": [
            _classes(),
            _clips(clips_csv),
            _table("frames", "A record a frame.", FRAME_COLUMNS),
            _table("actors", "A record a moving actor and frame.", ACTOR_COLUMNS),
        ],
    }


def _node(kind: str, name: str, **facts: object) -> dict:
    """Returns a part of the metadata; its name begins with that of the part that holds it."""
    return {"@type": f"cr:{kind}", "@id": name, "name": name.rpartition("/")[2], **facts}


def _file_object(root: Path, path: Path, encoding: str) -> dict:
    return _node(
        "FileObject",
        path.name,
        contentUrl=path.relative_to(root).as_posix(),
        contentSize=f"{path.stat().st_size} B",
        encodingFormat=encoding,
        sha256=sha256_of(path),
    )


def _file_set(name: str) -> dict:
    """Describes the files of one name, one in the folder of each clip."""
    encoding, content = FILE_SETS[name]
    facts = {"description": content, "encodingFormat": encoding}
    return _node("FileSet", name, **facts, includes=f"*/*/{name}")


def _classes() -> dict:
    """Lists the class ids of the voxels, as an enumeration."""
    facts = {"dataType": "sc:Enumeration", "key": {"@id": "classes/id"}}
    fields = [
        _node("Field", "classes/id", description="value of a voxel", dataType="sc:Integer"),
        _node("Field", "classes/name", description="name of the class", dataType="sc:Text"),
    ]
    rows = [{"classes/id": n, "classes/name": name} for n, name in enumerate(CLASSES)]
    return _node("RecordSet", "classes", **facts, field=fields, data=rows)


def _clips(clips_csv: Path) -> dict:
    files = {"fileObject": {"@id": clips_csv.name}}
    columns = pd.read_csv(clips_csv, nrows=0).columns
    fields = [_column(f"clips/{name}", {**files, "extract": {"column": name}}) for name in columns]
    facts = {"description": "A record a clip.", "key": {"@id": "clips/clip"}}
    return _node("RecordSet", "clips", **facts, field=fields)


def _table(name: str, description: str, columns: list[str]) -> dict:
    """Describes the tables of one name in all clips; the folder says which clip it is."""
    files = {"fileSet": {"@id": f"{name}.csv"}}
    folder = {"regex": f"^(.*)/{name}[.]csv$"}
    clip = {**files, "extract": {"fileProperty": "fullpath"}, "transform": folder}

    fields = [_column(f"{name}/clip", clip)]
    for column in columns:
        fields.append(_column(f"{name}/{column}", {**files, "extract": {"column": column}}))
    return _node("RecordSet", name, description=description, field=fields)


def _column(name: str, source: Mapping) -> dict:
    """Describes a column by its type and meaning, and where it is read."""
    kind, meaning = COLUMNS[name.rpartition("/")[2]]
    return _node("Field", name, description=meaning, dataType=kind, source=source)
