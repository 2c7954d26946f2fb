"""A mistake in a study's plan is a line that names the file or the key."""

import pytest

from src.errors import UserError
from studies.settings import composed, read_plan


@pytest.mark.parametrize("text", [None, "", "seeds: [", "changes: {}"])
def test_a_plan_that_cannot_be_read_or_lacks_a_key_is_named(text, tmp_path):
    path = tmp_path / "plan.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError, match=r"^--plan: .*plan\.yaml (cannot be|has no 'seeds')"):
        read_plan(path, "seeds", "changes")
    path.write_text("{seeds: [0], changes: {}}")
    assert read_plan(path, "seeds", "changes") == {"seeds": [0], "changes": {}}


def test_the_overrides_of_a_plan_are_checked_as_those_of_a_command():
    with pytest.raises(UserError, match=r"^perception\.amount: 'lots' is not a number"):
        composed(["task=fly", "perception=damaged", "perception.amount=lots"])
