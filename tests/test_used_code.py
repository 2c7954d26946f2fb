"""Which code a configuration uses, and what changes its digest; .ci/pythons asks every Python."""

import ast
import csv
import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from src import used_code
from src.data.manifest import DatasetSpec
from src.provenance import digest_of
from src.run_folder import TRAINING, RunFolder, shaping
from src.used_code import SOURCE, code_of, different_file, file_digest, targets_of
from tests.synthetic import compose_config

# ----------------------------------------------------------------------------------- of a file


CODE = '''WORDS = "a", "1", None


def f(x):
    """Doubles."""
    if x < 0:
        raise ValueError("negative")
    return 2 * x
'''


@pytest.mark.parametrize(
    ("edit", "counts"),
    [
        (("Doubles", "Gives twice x"), False),
        (('    """Doubles."""\n', "    # why\n"), False),
        (("2 * x", "(\n        2\n        * x\n    )"), False),
        (("negative", "below zero"), False),
        (("2 *", "3 *"), True),
        (("2 *", "2.0 *"), True),
        (("def f(x)", "def f(x, y=0)"), True),
        (("def f(x)", "X = 1\ndef f(x)"), True),
        (("ValueError", "TypeError"), True),
        (('"a"', '"b"'), True),
        (('"1"', "1"), True),
        (("None", "0"), True),
    ],
    ids=str,
)
def test_statements_count_and_prose_and_layout_do_not(edit, counts):
    text = CODE.replace(*edit)
    assert text != CODE
    assert (file_digest(text) != file_digest(CODE)) == counts


# --------------------------------------------------------------------------------- of the project


@pytest.fixture(scope="module")
def config():
    """The configuration of a tiny run of SkyOcc."""
    cfg = compose_config("+experiment=skyocc", "scale=tiny", "sim.towns=[downtown]")
    return OmegaConf.to_container(cfg, resolve=True)


@pytest.fixture
def source(tmp_path, monkeypatch):
    """A copy of ``src/`` that may be edited."""
    copy = tmp_path / "src"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(used_code, "SOURCE", copy)
    return copy


def identities(config):
    dataset = DatasetSpec.of("tiny", config["sim"])
    return dataset.digest, RunFolder(Path("runs/x"), config, "tiny-0").version


# An edit of a file of ``src/``, and whether it gives a dataset and a run another identity.
EDITS = (
    ("tasks/fit.py", "X = 1", False, False),
    ("tasks/report.py", "X = 1", False, False),
    ("models/__init__.py", "X = 1", False, False),
    ("models/bilinear_lift.py", "X = 1", False, False),
    ("sim/towns/triangle.py", "X = 1", False, False),
    ("sim/towns/downtown.py", "# A comment.", False, False),
    ("sim/towns/downtown.py", "X = 1", True, False),
    ("sim/towns/streetscape.py", "X = 1", True, False),
    ("models/losses.py", "X = 1", False, True),
    ("models/attention.py", "X = 1", False, True),
    ("metrics/safety.py", "X = 1", False, True),
    ("tasks/model.py", "X = 1", False, True),
    ("geometry.py", "X = 1", True, True),
    ("data/clip.py", "X = 1", True, True),
)


def test_an_edit_changes_what_uses_it_and_nothing_else(config, source):
    before = identities(config)
    for file, line, *changes in EDITS:
        path = source / file
        text = path.read_text() if path.exists() else ""
        path.write_text(f"{text}\n{line}\n")
        after = identities(config)
        assert [one != other for one, other in zip(before, after)] == changes, file
        path.write_text(text)


def test_names_are_found_through_packages_and_libraries_do_not_count():
    assert list(targets_of({"a": [{"_target_": "x.Y", "b": {"_target_": "z"}}]})) == ["x.Y", "z"]
    assert "metrics/safety.py" in code_of(["src.metrics.SafetyScores"])
    assert "metrics/__init__.py" not in code_of(["src.metrics.SafetyScores"])
    assert "models/losses.py" in code_of(["src.models.losses.cross_entropy"])
    assert code_of(["torch.optim.AdamW", "lightning.Trainer", "builtins.dict"]) == {}
    assert code_of(["no_such_package.Thing", ""]) == {}
    assert code_of(["src.models.losses.gone"]) == code_of(["src.models.losses"])


def test_a_class_outside_src_counts_by_its_file_and_what_that_imports(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    mine = tmp_path / "my_losses"
    mine.mkdir()
    (mine / "__init__.py").write_text("from .dice import Dice\n")
    (mine / "dice.py").write_text("import numpy\nfrom src.ontology import FREE\nclass Dice: ...\n")
    (mine / "other.py").write_text("X = 1\n")
    (tmp_path / "single_loss.py").write_text("def f(): ...\n")
    assert list(code_of(["my_losses.Dice"])) == ["my_losses.dice", "ontology.py"]
    assert code_of(["my_losses.Dice"]) == code_of(["my_losses.dice.Dice"])
    assert list(code_of(["single_loss.f"])) == ["single_loss"]

    before = code_of(["my_losses.Dice"])
    (mine / "dice.py").write_text("class Dice: X = 1\n")
    assert different_file(before, code_of(["my_losses.Dice"])) == "my_losses.dice"


def test_the_first_file_that_both_use_and_that_differs_is_named():
    before = {"a.py": "1", "b.py": "2"}
    assert different_file(before, dict(before)) == ""
    assert different_file(before, {"a.py": "1", "b.py": "3", "c.py": "4"}) == "src/b.py"
    assert different_file(before, {"b.py": "2"}) == ""


def test_what_is_imported_by_name_at_run_time_is_named_by_the_configuration(config):
    """Towns and classes; a syntax tree would not show other such imports."""
    used = code_of(["src.sim.generate", "src.tasks.model", *targets_of(shaping(config))])
    found = set()
    for file in used:
        tree = ast.parse((SOURCE / file).read_text())
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        if names & {"import_module", "__import__", "instantiate", "get_object"}:
            found.add(file)
    of_config = {"metrics/suite.py", "models/checkpoint.py", "tasks/model.py"}
    assert found == {"sim/towns/__init__.py", *of_config}


def test_files_that_do_not_count_are_there():
    assert all((SOURCE / file).is_file() for file in used_code.NEUTRAL)


def test_what_is_finished_stays_finished_or_its_new_name_is_told():
    """An edit that changes no byte and no bit has a line in src/same_bits.csv, for which two runs
    were compared; any other one gives new names, which docs/identities.csv tells."""
    with (Path("docs/identities.csv")).open(newline="") as file:
        told = {row["of"]: row["now"] for row in csv.DictReader(file)}
    configs = {}
    for scale in ("tiny", "small", "ladder", "paper"):
        cfg = compose_config("+experiment=skyocc", f"scale={scale}")
        configs[scale] = OmegaConf.to_container(cfg, resolve=True)
    names = {
        f"data of scale={scale}": DatasetSpec.of(scale, config["sim"]).root(Path()).name
        for scale, config in configs.items()
    }
    code = code_of([TRAINING, *targets_of(shaping(configs["ladder"]))])
    assert {**names, "code of a run of the ladder": digest_of(code)} == told


def test_only_files_that_are_there_are_the_same_as_older_ones():
    now = {
        (path.relative_to(SOURCE).as_posix(), file_digest(path.read_text()))
        for path in SOURCE.rglob("*.py")
    }
    assert set(used_code._same_as()) <= now, "drop what no file has any more"
