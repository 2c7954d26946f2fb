"""Which frame is for what."""

import pytest

from src.data.split import held_out_clips, make_split
from src.errors import UserError

PAPER = [f"town{town}/clip{clip:02d}" for town in range(8) for clip in range(15)]


def test_the_paper_s_numbers():
    held_out = ["town2/clip14"], ["town0/clip07", "town1/clip03", "town3/clip11"]
    split = make_split(PAPER, 300, 25, *held_out)
    sizes = {part: len(frames) for part, frames in split.items()}
    assert sizes == {"train": 29_000, "val": 3_200, "test": 3_800}


@pytest.mark.parametrize("capture_hz", [2.5, 5, 12.5, 25])
def test_every_frame_is_in_exactly_one_part_and_in_its_second(capture_hz):
    frames = round(12 * capture_hz)
    split = make_split(PAPER[:6], frames, capture_hz, [PAPER[1]], [PAPER[2], PAPER[5]])
    every = [sample for part in split.values() for sample in part]
    assert sorted(every) == sorted((clip, k) for clip in PAPER[:6] for k in range(frames))
    seconds = {"train": (0, 10), "val": (10, 11), "test": (11, 12)}
    for part, (low_s, high_s) in seconds.items():
        times_s = [k / capture_hz for clip, k in split[part] if clip in (PAPER[0], PAPER[3])]
        assert low_s <= min(times_s) <= max(times_s) < high_s
    for part, clip in (("val", PAPER[1]), ("test", PAPER[5])):
        assert split[part].count((clip, 0)) == split[part].count((clip, frames - 1)) == 1


def test_held_out_clips_are_found_again_in_the_split():
    split = make_split(PAPER[:6], 30, 2.5, [PAPER[4]], [PAPER[5], PAPER[2]])
    assert held_out_clips(split) == {"val": [PAPER[4]], "test": [PAPER[2], PAPER[5]]}
    assert held_out_clips(make_split(PAPER[:6], 30, 2.5, [], [])) == {"val": [], "test": []}


@pytest.mark.parametrize(
    ("val_clips", "test_clips", "message"),
    [
        (["town9/clip00"], [], r"town9/clip00.*town0/clip00"),
        (["town0/clip01"], ["town0/clip01"], "twice"),
        ([], ["town0/clip01", "town0/clip01"], "twice"),
    ],
)
def test_held_out_clips_must_exist_and_be_named_once(val_clips, test_clips, message):
    with pytest.raises(UserError, match=rf"data\.val_clips.*{message}"):
        make_split(PAPER, 300, 25, val_clips, test_clips)
