"""The class list that data, losses and scores share."""

import re
from pathlib import Path

from src import ontology

CLASSES_OF_THE_CONTRACT = [
    *("building", "ground", "vegetation", "thin_structure", "large_vehicle", "car", "vru"),
    *("general", "free"),
]


def test_ids_are_the_places_in_the_contract() -> None:
    assert list(ontology.CLASSES) == CLASSES_OF_THE_CONTRACT
    for class_id, name in enumerate(CLASSES_OF_THE_CONTRACT):
        assert getattr(ontology, name.upper()) == class_id


def test_free_is_last_and_everything_before_it_is_occupied() -> None:
    assert ontology.FREE == ontology.NUM_CLASSES - 1 == 8
    assert ontology.OCCUPIED == (0, 1, 2, 3, 4, 5, 6, 7)


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


def test_the_page_of_conventions_lists_the_same_classes() -> None:
    page = Path(__file__).parents[1] / "docs" / "conventions.md"
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    expected = [(class_id, name) for class_id, name in enumerate(ontology.CLASSES)]
    expected.append((ontology.UNKNOWN, "unknown"))
    assert [(int(class_id), name) for class_id, name in rows] == expected
