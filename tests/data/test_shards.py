"""Shards of one dataset find each other; those of two never mix."""

from dataclasses import replace

import pytest

from src.data.manifest import DatasetSpec
from src.data.shards import forget_shards, join_shards, record_of, share_of
from src.errors import UserError


@pytest.fixture
def spec(mini_sim):
    return DatasetSpec.of("mini", mini_sim)


def test_every_item_is_in_one_share():
    assert [share_of("abcdefg", k, 3) for k in range(3)] == [list("adg"), list("be"), list("cf")]
    for shard, shards in ((3, 3), (-1, 3), (0, 0)):
        with pytest.raises(UserError, match=r"sim\.shard"):
            share_of("abc", shard, shards)


def test_shards_of_the_same_settings_join(spec, tmp_path):
    for _ in range(3):
        join_shards(tmp_path, spec, 4)
    assert [path.name for path in tmp_path.iterdir()] == [".mini.shards.json"]
    for _ in range(2):
        forget_shards(tmp_path, spec)
        assert not list(tmp_path.iterdir())


def test_other_settings_another_number_and_other_code_are_refused(spec, mini_sim, tmp_path):
    join_shards(tmp_path, spec, 4)
    other = DatasetSpec.of("mini", mini_sim | {"seed": 7})
    for joining, shards, message in (
        (other, 4, r"sim\.seed: .* 7\b.* 0\b.*\.mini\.shards\.json"),
        (spec, 2, r"sim\.shards: .* 2\b.* 4\b"),
        (replace(spec, generator="abc"), 4, r"code of sim: .*abc"),
    ):
        with pytest.raises(UserError, match=rf"^[^\n]*{message}[^\n]*$"):
            join_shards(tmp_path, joining, shards)
    # Scales do not meet.
    join_shards(tmp_path, replace(other, scale="small"), 2)
    # What is finished elsewhere leaves this record alone.
    forget_shards(tmp_path, other)
    join_shards(tmp_path, spec, 4)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"sim": 3}'])
def test_a_record_that_cannot_be_read_is_named(spec, tmp_path, text):
    record_of(tmp_path, "mini").write_text(text)
    with pytest.raises(UserError, match=r"\.mini\.shards\.json"):
        join_shards(tmp_path, spec, 2)
