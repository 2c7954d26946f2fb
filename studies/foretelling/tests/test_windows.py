"""The scores of two seconds at a time: what they are of, and their file."""

import numpy as np
import pytest

from src.errors import UserError
from studies.foretelling.windows import WINDOWS, windows_of
from tests.results.flown import SECONDS, write_flown

SCORES = ("kar_miou", "phantom_stop_rate")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("flight")
    write_flown(root, "mine", 1.0, lambda m, n: m == n == 0, before=0.4)
    return root / "damaged/mine/flown/frames"


def test_a_window_has_the_two_seconds_that_it_ends_with(root):
    windows = windows_of(root, SCORES)
    assert list(windows) == [f"town-{town}/{n:03d}" for town in (100, 101, 102) for n in (0, 1)]

    # Wrong were the last second but one, and the one before it.
    of_first = windows["town-100/000"]["kar_miou"]
    assert np.flatnonzero(of_first < 1).tolist() == [SECONDS - 3, SECONDS - 2, SECONDS - 1]
    assert of_first[SECONDS - 2] == of_first[1:].min()
    assert np.isnan(of_first[0])
    assert (windows["town-101/000"]["kar_miou"][1:] == 1).all()


def published(path, windows):
    """The file that was published: all values of a score, flight after flight."""
    flights = [*windows.values()]
    arrays = {score: np.concatenate([each[score] for each in flights]) for score in SCORES}
    seconds = [len(each[SCORES[0]]) for each in flights]
    np.savez(path, flights=np.array([*windows]), seconds=seconds, **arrays)
    return path


def test_published_windows_are_read_as_they_were(root, tmp_path):
    windows = windows_of(root, SCORES)
    again = windows_of(published(tmp_path / WINDOWS, windows), SCORES)
    assert list(again) == list(windows)
    np.testing.assert_equal(again, windows)


def test_an_absent_score_and_a_broken_file_are_told(root, tmp_path):
    path = published(tmp_path / WINDOWS, windows_of(root, SCORES))
    for place in (root, path):
        with pytest.raises(UserError, match=r"task.scores.mine: no score of .*; there are .*kar_"):
            windows_of(place, ["mine"])
    path.write_bytes(path.read_bytes()[:90])
    with pytest.raises(UserError, match=r"windows.npz: cannot be read"):
        windows_of(path, SCORES)
