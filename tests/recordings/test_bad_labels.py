"""Classes that are none of ours stop at the border: compiled code counts votes by class."""

import pandas as pd
import pytest

from src.errors import UserError
from src.recordings.plain import ACTOR_COLUMNS, _tracks_of


@pytest.mark.parametrize("class_id", [-1, 8, 255, 300])
def test_an_actor_of_no_occupied_class_is_refused(tmp_path, class_id):
    path = tmp_path / "actors.csv"
    row = {**dict.fromkeys(ACTOR_COLUMNS, 1), "type": "car", "class_id": class_id}
    pd.DataFrame([row]).to_csv(path, index=False)
    with pytest.raises(UserError, match=f"class_id {class_id} of actor 1") as error:
        _tracks_of(path, 3)
    assert "\n" not in str(error.value)
