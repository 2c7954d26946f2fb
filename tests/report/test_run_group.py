"""Which runs may stand in one table."""

import dataclasses

import pandas as pd
import pytest

from src.errors import UserError
from src.ontology import FREE
from src.report.ladder_report import _facts
from src.report.run_group import OTHER_PROCESSOR, group_of
from src.results.runs import read_run
from src.run_folder import ANCHORS
from src.tasks.scoring import parts_of
from tests.results.scored import ladder_of, protocol, write_run


def names(group):
    return [str(run) for run in group.runs]


def test_runs_are_sorted_as_the_tables_are(tmp_path):
    for name, seed in (("skyocc", 0), ("baseline", 1), ("aspp", 0), ("baseline", 0)):
        write_run(tmp_path, name, seed)
    group = group_of(ladder_of(tmp_path))
    assert names(group) == ["baseline seed 0", "baseline seed 1", "skyocc seed 0", "aspp seed 0"]
    assert [str(run) for run in group.rungs] == names(group)[:3]
    assert list(group.counts()) == ["baseline", "skyocc", "aspp", *ANCHORS]
    assert list(group.counts()["baseline"]) == [0, 1]


def test_parts_are_those_of_the_split(tmp_path):
    write_run(tmp_path)
    write_run(tmp_path / "other", data__test_clips=[])
    group, other = (group_of(ladder_of(folder)) for folder in (tmp_path, tmp_path / "other"))
    parts = group.parts(parts_of)
    assert [(part.name, part.resamples.clips, part.resamples.frames) for part in parts] == [
        *(("test", 5, 7), ("test_unseen_clips", 1, 3), ("test_seen_clips", 4, 4)),
    ]
    assert [part.name for part in other.parts(parts_of)] == ["test", "test_seen_clips"]


OTHERS = {
    "protocol": ({"of": protocol(horizon_s=4.0)}, r"metric\.horizon_s=4\.0, and .* with 5\.0"),
    "dataset": ({"of": protocol("tiny-4567")}, r"dataset=tiny-4567, and .* with tiny-0123"),
    "code": ({"code": "0ther"}, r"was trained by code 0ther, and .* by code c0de; train both"),
    "unknown code": ({"code": None}, r"was trained by unknown code, and .* by code c0de"),
    "labels": ({"labels": 1}, r"was scored on other labels than .*baseline/seed0; score both"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_runs_that_are_not_alike_are_refused(tmp_path, other):
    changes, said = OTHERS[other]
    write_run(tmp_path, "baseline", 0)
    folder = write_run(tmp_path, "skyocc", 0, **changes)
    runs = ladder_of(tmp_path)
    with pytest.raises(UserError, match=f"{said}.*or report them apart, each .*") as caught:
        group_of(runs)
    assert str(caught.value).startswith(str(folder))
    assert "\n" not in str(caught.value)


def test_other_labels_are_noticed_where_the_anchors_are_kept_elsewhere(tmp_path):
    # As in published runs, whose anchors lie beside one of them.
    runs = [write_run(tmp_path, "attitude"), write_run(tmp_path, "skyocc", labels=1)]
    for anchor in ANCHORS:
        (runs[0] / f"tallies/{anchor}.npz").unlink()
    with pytest.raises(UserError, match=r"was scored on other labels than .*attitude/seed0"):
        group_of(ladder_of(tmp_path))


def labelled_otherwise(folder, beyond):
    """Two runs, of which one has as many voxels labelled otherwise as may be, and some more."""
    runs = [read_run(write_run(folder, name)) for name in ("baseline", "skyocc")]
    count = 1000 * runs[0].counts.tables["occupancy"]["count"]
    moved, voxels = count.clone(), int(OTHER_PROCESSOR * int(count.sum())) + beyond
    moved[0, FREE, FREE] -= voxels
    moved[0, 0, FREE] += voxels
    return [
        dataclasses.replace(
            run, counts=dataclasses.replace(run.counts, tables={"occupancy": {"count": table}})
        )
        for run, table in zip(runs, (count, moved))
    ]


def test_labels_of_another_processor_stand_in_one_report_which_says_so(tmp_path):
    group = group_of(labelled_otherwise(tmp_path, beyond=0))
    assert group.runs[1].counts.scored_on_other(group.runs[0].counts) == "other labels"
    facts = dict(next(_facts(group)).rows)
    share = f"{1e6 * group.unlike_labels:.1f} of a million voxels"
    assert facts["Labels of other processors"] == [share]
    assert 90 < 1e6 * group.unlike_labels <= 100


def test_labels_that_differ_in_more_are_refused(tmp_path):
    with pytest.raises(UserError, match="was scored on other labels"):
        group_of(labelled_otherwise(tmp_path, beyond=1))


def test_other_clips_are_refused(tmp_path):
    one, other = (read_run(write_run(tmp_path, name)) for name in ("baseline", "skyocc"))
    renamed = dataclasses.replace(other.counts, clips=["x/clip00", *other.counts.clips[1:]])
    other = dataclasses.replace(other, counts=renamed)
    with pytest.raises(UserError, match="was scored on other clips or frames than"):
        group_of([one, other])


def test_two_runs_of_one_seed_are_refused(tmp_path):
    runs = [read_run(write_run(tmp_path / place)) for place in ("a", "b")]
    with pytest.raises(UserError, match=r"b/skyocc/seed0 and .*both are skyocc seed 0; name one"):
        group_of(runs)


def test_counts_of_another_scoring_than_the_results_are_refused(tmp_path):
    folder = write_run(tmp_path)
    table = pd.read_csv(folder / "results.csv")
    table.loc[table["experiment"] == "skyocc", "miou"] += 0.01
    table.to_csv(folder / "results.csv", index=False)
    group = group_of([read_run(folder)])
    with pytest.raises(UserError, match=r"skyocc/seed0: results\.csv says mIoU .* and the counts"):
        group.parts(parts_of)
