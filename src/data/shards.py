"""Shares of one dataset, each made by a process or machine of its own.

Settings decide the folder's name, so shards of different settings would never meet: each would
leave a part of another dataset. Therefore the first shard leaves a record beside the folder,
against which all others are held until the dataset is whole.
"""

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from ..atomic import replacing
from ..dotted import differences, short
from ..errors import UserError, way_out_of
from .manifest import DatasetSpec

T = TypeVar("T")


def share_of(items: Sequence[T], shard: int, shards: int) -> list[T]:
    """Returns the items that one of several shards makes: every ``shards``-th item.

    Raises `UserError` for a shard that there is not.
    """
    if shards < 1:
        raise UserError(f"sim.shards: {shards} is too small; give 1 or more")
    if not 0 <= shard < shards:
        raise UserError(
            f"sim.shard: there is no {shard} of {shards} shards; give 0 to {shards - 1}"
        )
    return list(items[shard::shards])


def record_of(data_folder: Path, scale: str) -> Path:
    """Returns the file that says which dataset of a scale is being made in shards."""
    return data_folder / f".{scale}.shards.json"


def join_shards(data_folder: Path, spec: DatasetSpec, shards: int) -> None:
    """Leaves the record, or refuses to join shards of other settings, code or number."""
    path = record_of(data_folder, spec.scale)
    joining = _record(spec) | {"sim.shards": shards}
    _write_first(path, joining)

    try:
        changed = next(differences(json.loads(path.read_text()), joining), None)
    except FileNotFoundError:
        return  # The others have just finished.
    except (OSError, ValueError, TypeError, AttributeError) as error:
        way_out = way_out_of(error, "delete it")
        raise UserError(f"{path}: cannot be read ({error}); {way_out}") from error

    if changed:
        setting, old, new = changed
        raise UserError(
            f"{setting}: this shard has {short(new)}, and the shards under way have {short(old)}; "
            f"give all shards of a dataset the same, or delete {path} if no other is to be finished"
        )


def forget_shards(data_folder: Path, spec: DatasetSpec) -> None:
    """Removes the record of a dataset that is whole now; that of another one stays."""
    path = record_of(data_folder, spec.scale)
    with suppress(FileNotFoundError, ValueError, AttributeError):
        if json.loads(path.read_text()).items() >= _record(spec).items():
            path.unlink(missing_ok=True)


def _record(spec: DatasetSpec) -> dict:
    """Returns what all shards of a dataset have in common, by the names of its messages."""
    return {"sim": spec.sim, "code of sim": spec.generator}


def _write_first(path: Path, record: dict) -> None:
    """Writes the record unless there is one; of several at once, one succeeds."""
    candidate = path.with_name(f"{path.name}.{os.getpid()}")
    with replacing(candidate) as temporary:
        temporary.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")

    try:
        # A link fails where the file exists, and so only one shard is the first.
        with suppress(FileExistsError):
            os.link(candidate, path)
    finally:
        candidate.unlink()
