"""The class list that data, losses and scores share."""

import re
from pathlib import Path

import numpy as np
import pytest

from src import ontology


def test_ids_are_those_of_the_page_of_conventions() -> None:
    page = Path(__file__).parents[1] / "docs" / "conventions.md"
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    names = [*ontology.CLASSES, "unknown"]
    assert [(int(class_id), name) for class_id, name in rows] == [
        *((getattr(ontology, name.upper()), name) for name in names)
    ]
    assert [int(class_id) for class_id, _ in rows] == [*range(ontology.NUM_CLASSES), 255]


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


# Linear sRGB as people see it who lack one of two cones, by Machado, Oliveira and Fernandes (2009).
LACKING = {
    "green (deuteranopia)": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "red (protanopia)": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
    "none": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
}


@pytest.mark.parametrize("cone", LACKING)
def test_occupied_classes_can_be_told_apart_by_who_confuses_red_and_green(cone) -> None:
    """Two colors differ by 15 or more in CIELAB, where 2 can just be told apart side by side."""
    named = [ontology.CLASSES[class_id] for class_id in ontology.OCCUPIED]
    rgb = np.array([ontology.COLORS[name] for name in named]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ np.array(LACKING[cone]).T, 0, 1)

    xyz_from_rgb = np.array(
        [(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)]
    )
    x, y, z = np.cbrt(seen @ xyz_from_rgb.T / (0.9505, 1.0, 1.089)).T
    lab = np.stack([116 * y, 500 * (x - y), 200 * (y - z)], axis=1)
    apart = np.linalg.norm(lab[:, None] - lab, axis=-1)
    nearest = np.unravel_index(np.argmin(apart + 1e3 * np.eye(len(named))), apart.shape)
    assert apart[nearest] > 15, [named[n] for n in nearest]
