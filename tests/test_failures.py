"""A user's mistake is one line; a bug keeps its traceback."""

import errno
import os
import signal
import sys

import numpy as np
import pytest
import torch
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.utils import instantiate
from lightning import Trainer
from lightning.pytorch.demos.boring_classes import BoringModel
from lightning.pytorch.utilities.exceptions import SIGTERMException
from omegaconf import OmegaConf
from torch.utils.data import DataLoader

from src.errors import UserError
from src.failures import DISK, one_line, told_in_one_line
from tests.synthetic import compose_config


def caught(action, *arguments):
    with pytest.raises(Exception) as info:  # noqa: PT011
        action(*arguments)
    return info.value


def ctrl_c_in_a_training():
    """Lightning catches Ctrl-C there and exits with status 1."""
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        sys.exit(1)


def raising(error):
    raise error


@pytest.mark.parametrize(
    ("action", "status", "line"),
    [
        (lambda: raising(UserError("key: wrong; do x")), 2, "error: key: wrong; do x\n"),
        (lambda: raising(KeyboardInterrupt()), 130, "error: interrupted"),
        (ctrl_c_in_a_training, 130, "error: interrupted"),
        # Lightning's exception for the system's end of a training would leave with status 0.
        (lambda: raising(SIGTERMException()), 143, "error: the system ended"),
        (lambda: in_a_worker(terminated)(), 143, "error: the system ended"),
    ],
)
def test_an_end_is_one_line_and_a_status_although_the_program_asks_twice(
    action, status, line, capsys
):
    with pytest.raises(SystemExit) as info, told_in_one_line(), told_in_one_line():
        action()
    printed = capsys.readouterr().err
    assert info.value.code == status
    assert printed.startswith(line)
    assert printed.count("\n") == 1


def test_a_package_that_a_platform_lacks_is_named_and_any_other_one_is_a_bug():
    lacking = ModuleNotFoundError("No module named 'embreex'", name="embreex")
    assert one_line(lacking).startswith("embreex is not installed, and this task needs it")
    assert one_line(ModuleNotFoundError("No module named 'src.sin'", name="src.sin")) is None


def test_an_exit_for_another_reason_stays_what_it_is(capsys):
    with pytest.raises(SystemExit) as info, told_in_one_line():
        sys.exit(3)
    assert info.value.code == 3
    assert capsys.readouterr().err == ""


CFG = OmegaConf.create({"a": 1}, flags={"struct": True})
BUGS = {
    "a key": KeyError("x"),
    "a file of the program": FileNotFoundError(errno.ENOENT, "gone", "x"),
    "a size": RuntimeError("shape '[2, 3]' is invalid for input of size 5"),
    "a worker": RuntimeError("DataLoader worker (pid 3) is killed by signal: Aborted."),
    "a key that the program asks for in vain": caught(lambda: CFG.b),
}


@pytest.mark.parametrize("bug", BUGS)
def test_a_bug_keeps_its_traceback(bug):
    with pytest.raises(type(BUGS[bug])), told_in_one_line():
        raise BUGS[bug]


@pytest.mark.parametrize("code", DISK)
def test_a_disk_that_cannot_be_written_names_the_file(code):
    message = one_line(OSError(code, "text", "/data/clip/rgb.zip"))
    assert message == f"/data/clip/rgb.zip: {DISK[code]}"


def test_the_cause_counts_however_deep_it_lies():
    error = RuntimeError("loader")
    error.__cause__ = UserError("file: broken")
    assert one_line(error) == "file: broken"


class Samples:
    """Samples that a function makes, which fails."""

    def __init__(self, take):
        self.take = take

    def __len__(self):
        return 2

    def __getitem__(self, index):
        return self.take()


def in_a_worker(take):
    """Loads samples in another process."""
    return lambda: list(DataLoader(Samples(take), num_workers=1))


def broken():
    try:
        raise OSError("short read")
    except OSError as error:
        raise UserError("rgb.zip: cannot be read; delete it") from error


def test_a_message_from_a_loader_s_worker_arrives_whole():
    assert one_line(caught(in_a_worker(broken))) == "rgb.zip: cannot be read; delete it"


def killed():
    os.kill(os.getpid(), signal.SIGKILL)


def terminated():
    os.kill(os.getpid(), signal.SIGTERM)


def far_too_much():
    return np.empty(10**15)


def test_a_shared_memory_that_is_too_small_is_told_so():
    for error in (
        RuntimeError("unable to write to file </torch_12_34_5>: No space left on device (28)"),
        RuntimeError("unable to allocate shared memory(shm) for file </torch_1>: No space left"),
        RuntimeError("DataLoader worker (pid 3) is killed by signal: Bus error. It is possible"),
        OSError(errno.ENOSPC, "No space left on device", "/dev/shm/pym-12"),
    ):
        assert one_line(error).startswith("shared memory (/dev/shm) is too small")


@pytest.mark.parametrize(
    "override",
    [
        *("ckpt_path=runs/a/epoch=3-step=100.ckpt", "ckpt_path=~/x.ckpt"),
        *("ckpt_path=runs/josé/x.ckpt", "ckpt_path=a#b.ckpt", "ckpt_path=runs/[1]/x.ckpt"),
    ],
)
def test_a_value_that_hydra_cannot_read_is_told_to_be_quoted(override):
    error = caught(OverridesParser.create().parse_overrides, [override])
    value = override.partition("=")[2]
    assert f"""'ckpt_path="{value}"'""" in one_line(error)
    assert OverridesParser.create().parse_override(f'ckpt_path="{value}"').value() == value


def test_words_of_a_list_want_quotes_too():
    error = caught(OverridesParser.create().parse_overrides, ["task.runs=[~/a,~/b]"])
    way_out = one_line(error).partition("as in '")[2].rstrip("'")
    assert OverridesParser.create().parse_override(way_out).value() == ["a=1", "~/b"]


KNOBS = ("data.batch_size", "trainer.accumulate_grad_batches", "model.checkpointing=true")


@pytest.mark.parametrize(
    "take",
    [
        lambda: torch.empty(10**15),
        lambda: bytearray(10**15),
        far_too_much,
        lambda: raising(OSError(errno.ENOMEM, "Cannot allocate memory")),
        in_a_worker(far_too_much),
        in_a_worker(killed),
    ],
    ids=["torch", "python", "numpy", "fork", "loader", "killed"],
)
def test_a_machine_without_enough_memory_is_told_what_to_turn(take):
    message = one_line(caught(take))
    assert message.startswith("out of memory: ")
    assert all(knob in message for knob in (*KNOBS, "data.workers", "sim.workers"))


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nGPU 0 has"),
        RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be"),
        RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`"),
    ],
)
def test_a_gpu_without_enough_memory_is_told_what_to_turn(error):
    message = one_line(error)
    assert message.startswith("out of GPU memory: ")
    assert all(knob in message for knob in KNOBS)
    assert "workers" not in message
    assert "\n" not in message


def test_what_lightning_or_hydra_refuses_is_one_line():
    batches = DataLoader(Samples(lambda: 1.0))
    trainer = Trainer(accelerator="cpu", limit_train_batches=0.01, logger=False)
    assert one_line(caught(trainer.fit, BoringModel(), batches)).startswith(
        "trainer or callbacks: You requested to check 0.01 of the `train_dataloader`"
    )
    assert one_line(caught(compose_config, "logger=null")).startswith("a group was given null; ")


def test_a_mistake_in_a_file_of_ones_own_keeps_its_traceback_and_a_class_that_is_not_there_a_line(
    tmp_path, monkeypatch
):
    (tmp_path / "own_parts").mkdir()
    texts = {"mine": "x = undefined", "sound": "class Own: pass", "lacks": "import timmx"}
    for name, text in texts.items():
        (tmp_path / f"own_parts/{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    assert one_line(caught(instantiate, {"_target_": "own_parts.mine.Own"})) is None
    for target, reason in (
        ("own_parts.sound.Owm", "named 'own_parts.sound.Owm'"),
        ("own_parts.sond.Own", "sond'"),
        ("own_parts.lacks.Own", "timmx"),
    ):
        line = one_line(caught(instantiate, {"_target_": target}))
        assert line.startswith(f"Error locating target '{target}' (")
        assert reason in line


def test_numbers_in_the_place_of_a_rule_are_told_of_the_option_that_takes_them():
    weights = "loss.terms.cross_entropy.class_weights=[1,1,1,4,3,3,5,1,0.5]"
    assert "as loss/class_weights=manual for class weights" in one_line(
        caught(compose_config, weights)
    )
    by_hand = compose_config("loss/class_weights=manual", weights)
    assert by_hand.loss.terms.cross_entropy.class_weights[3] == 4


def test_other_messages_of_the_configuration_are_put_on_one_line():
    assert one_line(HydraException("first\n  second\n")) == "first second"
