"""Croissant 1.0 metadata of a dataset: JSON-LD that tools of the field read and load.

The format is MLCommons' (http://mlcommons.org/croissant/1.0). Its context stands in the file, so
that reading it needs no network.
"""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from ..ontology import ACTOR_TYPES, CLASSES
from .clip import ACTOR_COLUMNS, FRAME_COLUMNS, SUMS
from .files import sha256_of
from .manifest import MANIFEST

# The context of Croissant 1.0: names that stand for ``cr:<name>``, and the others.
_CROISSANT_NAMES = ["citeAs", "column", "equivalentProperty", "extract", "field", "fileObject"]
_CROISSANT_NAMES += ["fileProperty", "fileSet", "format", "includes", "isLiveDataset", "jsonPath"]
_CROISSANT_NAMES += ["key", "md5", "parentField", "path", "recordSet", "references", "regex"]
_CROISSANT_NAMES += ["repeated", "replace", "samplingRate", "separator", "source", "subField"]
_CROISSANT_NAMES += ["transform"]
_OTHER_NAMES = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
}
CONTEXT = dict(sorted({**{n: f"cr:{n}" for n in _CROISSANT_NAMES}, **_OTHER_NAMES}.items()))

# The files of a clip: what is in them, and by their endings how it is written.
FILE_SETS = {
    "clip.json": "town, weather, seed, camera and voxel grid of a clip",
    "frames.csv": "time, place, quaternion, velocity, attitude and height of every frame",
    "actors.csv": "class, place, velocity, size of every moving actor, every frame",
    "rgb.zip": "front images, 000000.jpg and so on",
    "occupancy.npz": "NumPy arrays [X, Y, Z] of each frame: semantics_000000 (uint8, 255 is "
    "unknown) and visible_000000 (bool)",
    "aux.npz": "NumPy arrays [H, W] of each frame: depth_000000 (float32, metres), class_000000 "
    "(uint8), instance_000000 (int32)",
    SUMS: "SHA-256 of every other file of the clip",
}
ENCODINGS = {
    ".json": "application/json",
    ".csv": "text/csv",
    ".zip": "application/zip",
    ".npz": "application/zip",
    "": "text/plain",
}

UNITS = {"m": "metres", "s": "seconds", "rad": "radians", "mps": "m/s", "radps": "rad/s"}
POSES = {
    "x_m": "position, east",
    "y_m": "position, north",
    "z_m": "position, up",
    "vx_mps": "velocity, east",
    "vy_mps": "velocity, north",
    "vz_mps": "velocity, up",
    "yaw_rad": "heading, counter-clockwise from east",
}
FRAME_MEANINGS = {
    **POSES,
    "frame": "number of the frame in its clip, from 0",
    "time_s": "time since the start of the clip",
    **{f"q{axis}": f"{axis} of the quaternion world_from_body, scalar last" for axis in "xyzw"},
    "wx_radps": "angular velocity about the body's x axis (forward)",
    "wy_radps": "angular velocity about the body's y axis (left)",
    "wz_radps": "angular velocity about the body's z axis (up)",
    "roll_rad": "roll, right side down positive",
    "pitch_rad": "pitch, nose down positive",
    "altitude_m": "height above the ground",
}
ACTOR_MEANINGS = {
    **POSES,
    "frame": "number of the frame in its clip, from 0",
    "actor_id": "number of the actor in its clip",
    "type": f"one of {', '.join(ACTOR_TYPES)}",
    "class_id": "class of its voxels, as in the record set classes",
    "length_m": "length of its box",
    "width_m": "width of its box",
    "height_m": "height of its box",
    "visible_pixels": "pixels of the front image that show it",
}
CLIP_MEANINGS = {
    "clip": "the clip's folder, <town>/<clip>",
    "town": "name of the town",
    "weather": "name of the illumination and weather",
    "role": "split: divided by time into train, val and test; val or test: held out as a whole",
    "capture_hz": "frames a second",
    "frames": "number of frames",
    "mean_altitude_m": "mean height above the ground",
    "mean_speed_mps": "mean speed",
    **{f"visible_{name}": f"visible actors, {name}, summed over frames" for name in ACTOR_TYPES},
    **{f"share_{name}": f"share of {name} among the labelled voxels" for name in CLASSES},
    "bytes": "size of all files",
}
INTEGERS = ("frame", "actor_id", "class_id", "frames", "bytes", "visible_pixels")
TYPES = {
    **dict.fromkeys(("clip", "type", "town", "weather", "role"), "sc:Text"),
    **dict.fromkeys((*INTEGERS, *(f"visible_{name}" for name in ACTOR_TYPES)), "sc:Integer"),
}


def croissant_of(root: Path, manifest: Mapping, description: str, clips_csv: Path) -> dict:
    """Returns the metadata as plain data, to be written to ``<root>/croissant.json``.

    ``clips_csv`` is a table with a row a clip, somewhere under ``root``. Every clip's files are
    covered by the manifest's hashes, and the manifest by its own here.
    """
    # All clips of a dataset have the same files.
    files = next(iter(manifest["clips"].values()))["files"]

    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": root.name,
        "description": description,
        "license": "https://spdx.org/licenses/MIT.html",
        "version": "1.0.0",
        "keywords": ["UAV", "semantic occupancy", "3-D scene understanding", "synthetic data"],
        "citeAs": "SkyShield: Occupancy as a Safety Interface for Low-Altitude UAV Autonomy",
        "distribution": [
            _file_object(root, root / MANIFEST),
            _file_object(root, clips_csv),
            *(_file_set(name) for name in FILE_SETS if name in files or name == SUMS),
            _node(
                "FileSet",
                "images",
                description="the front images in each rgb.zip",
                containedIn={"@id": "rgb.zip"},
                encodingFormat="image/jpeg",
                includes="*.jpg",
            ),
        ],
        "recordSet": [
            _classes(),
            _clips(clips_csv),
            _table("frames", "A record a frame.", FRAME_COLUMNS, FRAME_MEANINGS),
            _table("actors", "A record a moving actor and frame.", ACTOR_COLUMNS, ACTOR_MEANINGS),
        ],
    }


def _node(kind: str, name: str, **facts: object) -> dict:
    """Returns a part of the metadata; its name begins with that of the part that holds it."""
    return {"@type": f"cr:{kind}", "@id": name, "name": name.rpartition("/")[2], **facts}


def _file_object(root: Path, path: Path) -> dict:
    return _node(
        "FileObject",
        path.name,
        contentUrl=path.relative_to(root).as_posix(),
        contentSize=f"{path.stat().st_size} B",
        encodingFormat=ENCODINGS[path.suffix],
        sha256=sha256_of(path),
    )


def _file_set(name: str) -> dict:
    """Describes the files of one name, one in the folder of each clip."""
    facts = {"description": FILE_SETS[name], "encodingFormat": ENCODINGS[Path(name).suffix]}
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
    fields = [_column(f"clips/{name}", CLIP_MEANINGS[name], files) for name in columns]
    facts = {"description": "A record a clip.", "key": {"@id": "clips/clip"}}
    return _node("RecordSet", "clips", **facts, field=fields)


def _table(name: str, description: str, columns: list[str], meanings: Mapping[str, str]) -> dict:
    """Describes the tables of one name in all clips; the folder says which clip it is."""
    files = {"fileSet": {"@id": f"{name}.csv"}}
    folder = {"regex": f"^(.*)/{name}[.]csv$"}
    source = {**files, "extract": {"fileProperty": "fullpath"}, "transform": folder}
    clip = {"description": CLIP_MEANINGS["clip"], "dataType": TYPES["clip"], "source": source}

    fields = [_node("Field", f"{name}/clip", **clip)]
    fields += [_column(f"{name}/{column}", meanings[column], files) for column in columns]
    return _node("RecordSet", name, description=description, field=fields)


def _column(name: str, meaning: str, files: Mapping) -> dict:
    """Describes a column of tables, its unit beside its meaning."""
    column = name.rpartition("/")[2]
    unit = UNITS.get(column.rpartition("_")[2]) if "_" in column else None
    return _node(
        "Field",
        name,
        description=f"{meaning} ({unit})" if unit else meaning,
        dataType=TYPES.get(column, "sc:Float"),
        source={**files, "extract": {"column": column}},
    )
