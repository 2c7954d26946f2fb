"""The classes of a recording in ours: a table of their ids, or of words in their names."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt8

from ..errors import UserError, reason_of
from ..ontology import CLASSES, FREE, GENERAL, OCCUPIED, UNKNOWN

# Beside our eight classes a table has: no class known, and nothing at all.
UNLABELLED, SKY = "unknown", "sky"
_NOT_LISTED = 256
# The names of a TartanAir environment's classes.
NAMES = "seg_label_map.json"
# A word of so many letters may be a part of another one.
LONG = 5
# 16 bits: ids of instances are told apart by others.
_IDS = 1 << 16


@dataclass
class ClassTable:
    """Our class of every one of theirs.

    Args:
        table: by our class, and by ``unknown`` and ``sky``, their ids, or words of their names.
        names: their names by id, where the table has words. A name without any is general.

    ``unmatched`` are these names. Raises `UserError` for a class that is none of ours, and for an
    id that is listed twice.
    """

    table: Mapping[str, Sequence[int | str]]
    names: Mapping[int, str] | None = None
    unmatched: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        places = [CLASSES[k] for k in OCCUPIED] + [UNLABELLED, SKY]
        if strange := [name for name in self.table if name not in places]:
            raise UserError(f"layout.classes.{strange[0]}: there are {', '.join(places)}")
        self._map = np.full(_IDS, _NOT_LISTED, dtype=np.int32)
        self._sky = np.zeros(_IDS, dtype=bool)
        ids = self._ids_of_words() if self.names is not None else self.table
        for name, listed in ids.items():
            for their_id in listed:
                self._list(name, their_id)

    @property
    def by_id(self) -> dict[int, str]:
        """Our class of every id, by name; the sky is no place, and so unknown."""
        ids = np.flatnonzero(self._map != _NOT_LISTED)
        names = {**dict(enumerate(CLASSES)), UNKNOWN: UNLABELLED}
        return {int(each): names[int(self._map[each])] for each in ids}

    def _list(self, name: str, their_id: object) -> None:
        if type(their_id) is not int or not 0 <= their_id < _IDS:
            raise UserError(f"layout.classes.{name}: {their_id!r} is no id; give 0 to {_IDS - 1}")
        if self._map[their_id] != _NOT_LISTED:
            raise UserError(f"layout.classes.{name}: {their_id} is listed twice; keep one")
        self._sky[their_id] = name == SKY
        is_ours = name not in (UNLABELLED, SKY)
        self._map[their_id] = CLASSES.index(name) if is_ours else UNKNOWN

    def _ids_of_words(self) -> dict[str, list[int]]:
        """Returns the ids by our class; of several words in a name the longest one decides."""
        words = sorted(
            ((str(word).lower(), name) for name, listed in self.table.items() for word in listed),
            key=lambda each: -len(each[0]),
        )

        ids: dict[str, list[int]] = {}
        for their_id, their_name in self.names.items():
            found = next((name for word, name in words if _is_in(word, their_name)), None)
            if found is None:
                self.unmatched.append(their_name)
            ids.setdefault(found or CLASSES[GENERAL], []).append(their_id)
        return ids

    def of(
        self, path: Path, their_ids: Int[np.ndarray, "h w"]
    ) -> tuple[UInt8[np.ndarray, "h w"], np.ndarray]:
        """Returns our classes of an image of theirs, and where there is the sky.

        Raises `UserError` with the file for an id that the table does not list.
        """
        if their_ids.min(initial=0) < 0 or their_ids.max(initial=0) >= _IDS:
            raise UserError(
                f"{path}: class {their_ids.max()} is no id; are these colors, or depth?"
            )

        ours = self._map[their_ids]
        if (strange := their_ids[ours == _NOT_LISTED]).size:
            several = np.unique(strange)
            raise UserError(
                f"{path}: class {several[0]} is in no list of layout.classes ({len(several)} such "
                "in this image); list it there, or check that the image holds ids and not colors"
            )
        return ours.astype(np.uint8), self._sky[their_ids]


def _is_in(word: str, name: str) -> bool:
    """Tells whether a word is one of a name such as ``SM_OakTree_02``, or its plural.

    A long word may also be a part of another one, as grass of Grassland, and one of four letters
    its end, as wall of brickwall: but no car is in Carpet, and no sky in Whisky.
    """
    of_name = {part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}
    part = word in name.lower() if len(word) >= LONG else _ends(word, of_name)
    return part or bool({word, f"{word}s"} & of_name)


def _ends(word: str, parts: set[str]) -> bool:
    return len(word) == LONG - 1 and any(part.endswith((word, f"{word}s")) for part in parts)


def class_map_of(folder: Path, classes: dict) -> tuple[dict[int, str], list[str]]:
    """Returns our class of the ids of an environment's cloud, and the names that are general.

    ``classes`` are words as `ClassTable` takes them. Raises `UserError` without `NAMES`.
    """
    # Where the cloud has no point there is a 0, whatever its name.
    table = ClassTable(classes, {key: each for key, each in names_of(folder).items() if key})
    return {**table.by_id, 0: CLASSES[FREE]}, table.unmatched


def names_of(folder: Path) -> dict[int, str]:
    """Returns the names of an environment's classes, which lie beside or above a trajectory.

    Raises `UserError` where they do not.
    """
    for place in (folder, *folder.parents[:3]):
        path = place / NAMES
        if path.is_file():
            try:
                told = json.loads(path.read_text())["name_map"]
                return {int(number): str(name) for name, number in told.items()}
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise UserError(f"{path}: cannot be read ({reason_of(error)})") from error
    raise UserError(f"{folder}: no {NAMES} there or above it; it says what the class ids mean")
