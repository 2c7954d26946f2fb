"""results.csv to disk and back, and broken files."""

import errno
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from src.errors import UserError
from src.provenance import digest_of
from src.results.files import (
    COLUMNS,
    SCORES,
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
        "protocol": "0123456789ab",
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
    "quote": lambda text: text.replace("small-00ab", '"small-00ab', 1),
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


@pytest.mark.parametrize("name", ["NA", "null", "None", "nan", "1e5"])
def test_a_run_may_have_any_name(tmp_path, name):
    """pandas takes NA for a missing value: the run was trained, and then could not be read."""
    path = tmp_path / "results.csv"
    write_results(path, [row(name)])
    assert read_results(path)["experiment"].tolist() == [name]


def test_the_protocol_is_a_hash_and_was_once_a_text(tmp_path):
    path = tmp_path / "results.csv"
    write_results(path, [row(protocol='{"mask":"supervised"}'), row(protocol="0123456789ab")])
    assert read_results(path)["protocol"].tolist() == [
        digest_of('{"mask":"supervised"}'),
        "0123456789ab",
    ]
    published = read_results("docs/results/small/results.csv")["protocol"].unique()
    assert [f"protocol-{each}.json" for each in published] == [
        path.name for path in Path("docs/results/small").glob("protocol-*.json")
    ]


def test_what_may_not_be_read_is_not_to_be_deleted(tmp_path, monkeypatch):
    write_results(tmp_path / "results.csv", [row()])

    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("pathlib.Path.read_text", refuse)
    with pytest.raises(UserError, match="permission to read") as told:
        read_results(tmp_path / "results.csv")
    assert "delete" not in str(told.value)


def test_training_and_scoring_import_nothing_of_the_report():
    modules = "src.tasks.fit, src.tasks.test, src.tasks.score, studies.attitude.task"
    listed = f"import sys, {modules}; print([m for m in sys.modules if 'src.report' in m])"
    done = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr
