"""Names of TartanAir's environments, as they have them, become the classes that a UAV must know."""

import pytest
from omegaconf import OmegaConf

from src.recordings.classes import ClassTable
from tests.synthetic import compose_config


@pytest.fixture(scope="module")
def words():
    return OmegaConf.to_container(compose_config("layout=tartanair").layout.classes)


@pytest.mark.parametrize(
    ("ours", "names"),
    [
        ("thin_structure", ["electricpole", "electricalwires", "guardrail", "woodenlamppost"]),
        ("building", ["perimeterwall", "SM_Wall_02", "hangardoor", "trainstationglass"]),
        ("ground", ["GrasslandTerrain", "walkway", "traintracks", "rock"]),
        ("vegetation", ["SM_OakTree_02", "treestump"]),
        ("vru", ["pedestrian", "motorbike"]),
        # Parts of other words that are none of these.
        ("general", ["carpet", "whisky", "signature", "postcard", "bikerack", "businesscard"]),
    ],
)
def test_a_name_gets_the_class_of_its_longest_word(words, ours, names):
    assert set(ClassTable(words, dict(enumerate(names))).by_id.values()) == {ours}
