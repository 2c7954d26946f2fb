"""The class list that data, losses and scores share."""

import re
from pathlib import Path

from src import ontology


def test_ids_are_those_of_the_page_of_conventions() -> None:
    page = Path(__file__).parents[1] / "docs" / "conventions.md"
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    names = [*ontology.CLASSES, "unknown"]
    assert [(int(class_id), name) for class_id, name in rows] == [
        *((getattr(ontology, name.upper()), name) for name in names)
    ]
    assert [int(class_id) for class_id, _ in rows] == [*range(ontology.NUM_CLASSES), 255]


def test_unknown_and_sky_fit_a_byte_and_are_no_class() -> None:
    for value in (ontology.UNKNOWN, ontology.SKY):
        assert ontology.NUM_CLASSES <= value <= 255


def test_a_tie_has_one_winner_and_the_rare_classes_come_first() -> None:
    assert sorted(ontology.RAREST_FIRST) == sorted(ontology.OCCUPIED)
    share_percent = {"thin_structure": 0.26, "car": 0.071, "vru": 0.016}
    rarest_first = sorted(share_percent, key=share_percent.get)
    order = [ontology.CLASSES[class_id] for class_id in ontology.RAREST_FIRST]
    assert order[:3] == rarest_first


def test_every_actor_is_of_a_moving_class() -> None:
    moving = {ontology.LARGE_VEHICLE, ontology.CAR, ontology.VRU}
    assert set(ontology.ACTOR_TYPES.values()) == moving


def test_every_class_has_a_color_of_its_own() -> None:
    assert list(ontology.COLORS) == [*ontology.CLASSES, "unknown"]
    assert len(set(ontology.COLORS.values())) == len(ontology.COLORS)
    assert all(0 <= channel <= 255 for rgb in ontology.COLORS.values() for channel in rgb)
