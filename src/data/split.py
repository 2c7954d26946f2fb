"""The temporal split of App. A.1: no frame in two parts, and no random near-duplicates."""

from collections.abc import Sequence

from ..errors import UserError

TRAIN_UNTIL_S = 10.0
VAL_UNTIL_S = 11.0

PARTS = ("train", "val", "test")
# Of each part a list of (clip id, frame).
Split = dict[str, list[tuple[str, int]]]


def make_split(
    clip_ids: Sequence[str],
    frames_per_clip: int,
    capture_hz: float,
    val_clips: Sequence[str],
    test_clips: Sequence[str],
) -> Split:
    """Returns the frames of every part.

    Of a clip, [0, 10) s are for training, [10, 11) s for validation and [11, 12) s for test; a
    held-out clip belongs whole to validation or test. Raises `UserError` for a held-out clip that
    does not exist or is named twice.
    """
    held_out = [*val_clips, *test_clips]
    if unknown := [clip for clip in held_out if clip not in set(clip_ids)]:
        raise UserError(
            f"data.val_clips/data.test_clips: no clip {unknown[0]!r}; there are "
            f"{clip_ids[0]} to {clip_ids[-1]} ({len(clip_ids)} clips)"
        )
    if len(set(held_out)) < len(held_out):
        raise UserError("data.val_clips/data.test_clips: a clip is held out twice; name it once")

    split: Split = {part: [] for part in PARTS}
    whole = dict.fromkeys(val_clips, "val") | dict.fromkeys(test_clips, "test")
    # Clips and frames keep their order: a score of the test split depends on no shuffle.
    for clip in clip_ids:
        for frame in range(frames_per_clip):
            part = whole.get(clip) or part_of_time(frame / capture_hz)
            split[part].append((clip, frame))
    return split


def held_out_clips(split: Split) -> dict[str, list[str]]:
    """Returns the clips that belong whole to ``val`` or to ``test``, in the order of the split."""
    # A clip with a training frame is split by time; all others belong to one part.
    trained_on = {clip for clip, _ in split["train"]}
    return {
        part: list(dict.fromkeys(clip for clip, _ in split[part] if clip not in trained_on))
        for part in ("val", "test")
    }


def part_of_time(time_s: float) -> str:
    """Returns the part of a frame of a clip that is not held out."""
    if time_s < TRAIN_UNTIL_S:
        return "train"
    return "val" if time_s < VAL_UNTIL_S else "test"
