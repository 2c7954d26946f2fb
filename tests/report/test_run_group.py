"""Which runs may stand in one table."""

import dataclasses

import pandas as pd
import pytest

from src.errors import UserError
from src.ontology import FREE
from src.report.ladder_report import _facts
from src.report.run_group import OTHER_PROCESSOR, group_of
from src.results.counts import parts_of
from src.results.runs import read_run
from src.run_folder import ANCHORS
from tests.results.scored import ladder_of, protocol, write_run


def test_runs_are_sorted_as_the_tables_are(tmp_path):
    for name, seed in (("skyocc", 0), ("baseline", 1), ("aspp", 0), ("baseline", 0)):
        write_run(tmp_path, name, seed)
    group = group_of(ladder_of(tmp_path))
    names = ["baseline seed 0", "baseline seed 1", "skyocc seed 0", "aspp seed 0"]
    assert [str(run) for run in group.runs] == names
    assert [str(run) for run in group.rungs] == names[:3]
    assert list(group.counts()) == ["baseline", "skyocc", "aspp", *ANCHORS]
    assert list(group.counts()["baseline"]) == [0, 1]


def test_parts_are_those_of_the_split(tmp_path):
    for folder, changes, parts in (
        ("all", {}, [("test", 5, 7), ("test_unseen_clips", 1, 3), ("test_seen_clips", 4, 4)]),
        ("none", {"data__test_clips": []}, [("test", 5, 7), ("test_seen_clips", 5, 7)]),
    ):
        found = group_of([read_run(write_run(tmp_path / folder, **changes))]).parts(parts_of)
        of_parts = [(each.name, each.resamples.clips, each.resamples.frames) for each in found]
        assert of_parts == parts


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
    for anchor in ANCHORS:
        # As in published runs, whose anchors lie beside one of them.
        (folder / f"tallies/{anchor}.npz").unlink()
    with pytest.raises(UserError, match=f"{said}.*or report them apart, each [^\n]*$") as caught:
        group_of(ladder_of(tmp_path))
    assert str(caught.value).startswith(str(folder))


def test_other_clips_and_two_runs_of_one_seed_are_refused(tmp_path):
    one, other, again = (
        read_run(write_run(tmp_path / place, name))
        for place, name in (("a", "baseline"), ("a", "skyocc"), ("b", "baseline"))
    )
    renamed = dataclasses.replace(other.counts, clips=["x/clip00", *other.counts.clips[1:]])
    with pytest.raises(UserError, match="was scored on other clips or frames than"):
        group_of([one, dataclasses.replace(other, counts=renamed)])
    with pytest.raises(UserError, match=r"b/.*/seed0 and .*both are baseline seed 0; name one"):
        group_of([one, again])


@pytest.mark.parametrize("beyond", [0, 1])
def test_few_labels_of_another_processor_stand_in_one_report_which_says_so(tmp_path, beyond):
    runs = [read_run(write_run(tmp_path, name)) for name in ("baseline", "skyocc")]
    count = 1000 * runs[0].counts.tables["occupancy"]["count"]
    moved, voxels = count.clone(), int(OTHER_PROCESSOR * int(count.sum())) + beyond
    moved[0, FREE, FREE] -= voxels
    moved[0, 0, FREE] += voxels
    for n, table in enumerate((count, moved)):
        counts = dataclasses.replace(runs[n].counts, tables={"occupancy": {"count": table}})
        runs[n] = dataclasses.replace(runs[n], counts=counts)
    if beyond:
        with pytest.raises(UserError, match="was scored on other labels"):
            group_of(runs)
    else:
        (share,) = dict(_facts(group_of(runs)).rows)["Labels of other processors"]
        assert share.endswith(" of a million voxels")
        assert 90 < float(share.split()[0]) <= 100


def test_counts_of_another_scoring_than_the_results_are_refused(tmp_path):
    folder = write_run(tmp_path)
    table = pd.read_csv(folder / "results.csv")
    table.loc[table["experiment"] == "skyocc", "miou"] += 0.01
    table.to_csv(folder / "results.csv", index=False)
    group = group_of([read_run(folder)])
    with pytest.raises(UserError, match=r"skyocc/seed0: results\.csv says mIoU .* and the counts"):
        group.parts(parts_of)
