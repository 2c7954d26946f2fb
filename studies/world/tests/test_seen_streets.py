"""What training had seen is of the same streets, and no further away than a voxel."""

import numpy as np
import pandas as pd

from studies.world.seen_streets import _keys, in_any, main, streets_of
from tests.synthetic import compose_config, mini_overrides, write_dataset


def test_a_cell_had_been_seen_where_it_or_one_beside_it_was():
    seen = _keys(np.array([[0, 0, 0], [-5, 7, 2]]))
    cells = np.array([[0, 0, 0], [0, -1, 0], [-5, 7, 1], [1, 1, 0], [-5, 7, 4]])
    assert in_any(cells, seen).tolist() == [True, True, True, False, False]


def test_drawings_of_a_town_take_turns_clip_by_clip():
    assert [streets_of(f"park/clip0{n}", 3) for n in (0, 1, 3)] == [
        ("park", 0),
        ("park", 1),
        ("park", 0),
    ]
    assert streets_of("old_town/clip12", 1) == ("old_town", 0)


def test_a_town_of_the_test_alone_had_not_been_seen(tmp_path):
    words = mini_overrides(tmp_path, "+experiment=skyocc")
    write_dataset(compose_config(*words))
    main(*words, out=tmp_path / "seen.csv")
    table = pd.read_csv(tmp_path / "seen.csv").set_index(["part", "town"])
    share = table["share seen in training"]
    assert share["unseen flights", "suburb"] == 0 < share["last seconds", "downtown"]
    assert table.loc[("unseen flights", "suburb"), "voxels"] > 0
