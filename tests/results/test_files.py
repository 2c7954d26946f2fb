"""results.csv to disk and back, broken files, and the printed tables."""

import io
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from src.errors import UserError
from src.ontology import CLASSES
from src.results.files import (
    COLUMNS,
    MEANS,
    SCORES,
    print_results,
    read_results,
    write_results,
)


def row(experiment="skyocc", split="test", seed=0, **scores):
    rng = np.random.default_rng(len(experiment) + 100 * seed)
    return {
        "experiment": experiment,
        "scale": "small",
        "seed": seed,
        "split": split,
        "recipe": "strong",
        **{name: float(rng.random()) for name in SCORES},
        "protocol": '{"mask":"supervised","horizon_s":5.0}',
        "seconds": 0.1 + 0.2,
        "parameters": 1_234_567,
        "precision": "32-true",
        "code_version": "0012345678",
        "git_commit": "12e4567",
        "dataset": "small-00ab",
        **scores,
    }


def printed(rows, tmp_path):
    write_results(tmp_path / "results.csv", rows)
    console = Console(file=io.StringIO(), width=110)
    print_results(read_results(tmp_path / "results.csv"), console)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= 110
    assert "…" not in text
    return text


def line_of(text, name):
    return next(line for line in text.splitlines() if name in line)


def test_rows_read_back_as_they_were_written(tmp_path):
    absent = {"iou/vru": math.nan, "kar_iou/vru": math.nan}
    rows = [row(), row("all_free", seed=7, git_commit="", **absent)]
    path = tmp_path / "runs" / "results.csv"
    write_results(path, rows)
    table = read_results(path)
    assert tuple(table.columns) == COLUMNS
    for read, written in zip(table.to_dict("records"), rows):
        for name, value in written.items():
            both_nan = value != value and read[name] != read[name]
            assert read[name] == value or both_nan, name
    assert [entry.name for entry in path.parent.iterdir()] == ["results.csv"]


def test_a_row_with_other_columns_is_refused(tmp_path):
    with pytest.raises(ValueError, match="extra"):
        write_results(tmp_path / "results.csv", [row(extra=1)])
    incomplete = row()
    del incomplete["kar_miou"]
    with pytest.raises(ValueError, match="kar_miou"):
        write_results(tmp_path / "results.csv", [incomplete])
    assert not list(tmp_path.iterdir())


def test_a_place_below_a_file_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"file/results\.csv: cannot be written"):
        write_results(tmp_path / "file/results.csv", [row()])


CORRUPT = {
    "empty": lambda text: "",
    "prose": lambda text: "hello\nworld\n",
    "half": lambda text: text[: len(text) // 2],
    "newline": lambda text: text[:-1],
    "tail": lambda text: text[:-12] + "\n",
    "no experiment": lambda text: text.replace("skyocc", "", 1),
    "quote": lambda text: text.replace("supervised", 'super"vised'),
    "protocol": lambda text: text.replace('""mask""', "mask"),
    "column": lambda text: text.replace("kar_miou", "karmiou"),
    "number": lambda text: text.replace("0.", "O.", 1),
    "binary": lambda text: "\x00\ufffd" + text[40:],
}


@pytest.mark.parametrize("corrupt", CORRUPT)
def test_a_corrupt_file_is_named_in_one_line(tmp_path, corrupt):
    path = tmp_path / "results.csv"
    write_results(path, [row(), row()])
    path.write_text(CORRUPT[corrupt](path.read_text()))
    with pytest.raises(UserError, match=r"results\.csv: not a readable results file") as caught:
        read_results(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(UserError, match=r"none\.csv: no such file; finish the run"):
        read_results(tmp_path / "none.csv")


def test_rows_from_before_there_were_recipes_have_an_unknown_one(tmp_path):
    path = tmp_path / "results.csv"
    write_results(path, [row(), row("all_free", recipe="none")])
    assert list(read_results(path)["recipe"]) == ["strong", "none"]
    pd.read_csv(path).drop(columns="recipe").to_csv(path, index=False)
    assert list(read_results(path)["recipe"]) == ["unknown"] * 2
    published = Path("docs/results/small/results.csv")
    assert set(read_results(published)["recipe"]) == {"strong", "none"}


def test_a_printed_table_names_the_recipe_or_each_of_them(tmp_path):
    anchor = row("all_free", recipe="none")
    assert "mIoU occupied and KAR-mIoU; recipe strong" in printed([row(), anchor], tmp_path)
    both = printed([row(), row(seed=1, recipe="paper"), anchor], tmp_path)
    assert "; recipe" not in both
    assert [line_of(both, name).split()[-1] for name in ("skyocc 0", "skyocc 1", "all_free")] == [
        *("strong", "paper", "none")
    ]


def test_every_class_and_the_means_stand_side_by_side_as_percentages(tmp_path):
    scores = dict(zip(MEANS, (0.2891, 0.2024, 0.191))) | {"iou/car": 0.5, "kar_iou/car": 0.25}
    rows = [row(**scores), row("voxel_prior", **dict.fromkeys(SCORES, 0.01))]
    text = printed(rows, tmp_path)
    car = 2 + CLASSES.index("car")
    mine = line_of(text, "skyocc 0").split()
    assert (mine[:2], mine[car], mine[-3:]) == (
        *(["skyocc", "0"], "50.0*", ["28.9*", "20.2*", "19.1*"]),
    )
    assert line_of(text, "voxel_prior").split()[2:] == ["1.0"] * 12
    assert line_of(text, "skyocc 0: KAR-IoU").split()[1 + car] == "25.0"


def test_the_best_is_marked_within_each_split(tmp_path):
    values = {("longer_experiment", "test"): 0.5, ("two", "test"): 0.4}
    values |= {("three", "test_seen"): 0.2, ("voxel_prior", "test_seen"): 0.3}
    text = printed([row(*names, miou=value) for names, value in values.items()], tmp_path)
    starred = [name for name, _ in values if "*" in line_of(text, name).split()[-3]]
    assert starred == ["longer_experiment", "voxel_prior"]


def test_an_absent_class_is_a_dash_and_never_best(tmp_path):
    absent = {name: math.nan for name in SCORES}
    text = printed([row(**absent), row("all_free", **absent)], tmp_path)
    assert "nan" not in text
    assert line_of(text, "skyocc").split() == ["skyocc", "0", *["–"] * 12]


def test_training_and_scoring_import_nothing_of_the_report():
    modules = "src.tasks.fit, src.tasks.test, src.tasks.score, studies.attitude.task"
    listed = f"import sys, {modules}; print([m for m in sys.modules if 'src.report' in m])"
    done = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr
