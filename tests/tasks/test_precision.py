"""trainer.precision=auto: when bf16 is taken, that asking leaves no trace, and what is recorded."""

import json
from types import SimpleNamespace

import pytest
import torch
from torch import nn
from torchmetrics import MeanMetric

from src.errors import UserError
from src.models.losses import OccupancyLoss
from src.models.module import OccupancyModule
from src.ontology import NUM_CLASSES
from src.run_folder import RunFolder
from src.tasks import precision
from src.tasks.dataset import data_of
from src.tasks.precision import (
    BF16,
    FP32,
    faster,
    first_batch,
    obstacle_to_bf16,
    precision_of_run,
    probed,
    settled_precision,
    step_seconds,
)
from tests.models.synthetic import build_batch, build_network
from tests.synthetic import compose_config, mini_overrides, write_dataset

CPU = torch.device("cpu")


class Watched(OccupancyModule):
    """Draws a random number in each forward pass, and notes whether it was under autocast."""

    def __init__(self):
        loss = OccupancyLoss(torch.ones(NUM_CLASSES), lovasz_weight=1.0)
        super().__init__(build_network(), loss, MeanMetric, {}, nn.Identity())
        self.autocast = []

    def forward(self, batch):
        self.autocast.append(torch.is_autocast_enabled("cpu"))
        return super().forward(batch) + torch.rand(1)


def trainer_on(device, processes=1):
    """As much of a trainer as a choice looks at."""
    return SimpleNamespace(strategy=SimpleNamespace(root_device=device), world_size=processes)


@pytest.fixture
def module():
    return Watched()


@pytest.fixture
def batch():
    return build_batch(frames=2, image_size=(64, 32))


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path, {"paths": {"run": str(tmp_path)}})


@pytest.fixture
def probe_says(monkeypatch):
    """Lets a CPU without bf16 be probed, and settles what comes out."""

    def says(fp32_s, bf16_s):
        monkeypatch.setattr(precision, "obstacle_to_bf16", lambda device: None)
        monkeypatch.setattr(precision, "first_batch", lambda data: None)
        times = {FP32: [9, fp32_s], BF16: [bf16_s, 9]}
        monkeypatch.setattr(precision, "step_seconds", lambda *_: times)

    return says


def settled(folder, *words, processes=1):
    trainer = trainer_on(CPU, processes)
    return settled_precision(compose_config(*words), folder, None, None, trainer)


def test_several_processes_do_not_probe(folder, probe_says):
    probe_says(3.0, 1.0)
    choice = settled(folder, processes=2)
    assert choice.precision == FP32
    assert "several processes" in choice.reason
    assert settled(folder, processes=1) == choice, "and a resumed run goes on so"


def training_step(module, batch):
    """All that a step leaves behind."""
    torch.manual_seed(1)
    loss = module.loss(module(batch), batch["semantics"])["total"]
    loss.backward()
    gradients = [p.grad.clone() for p in module.parameters() if p.grad is not None]
    return [loss.detach(), *gradients, *(b.clone() for b in module.buffers()), torch.rand(1)]


# ------------------------------------------------------------------------------------- the decision


@pytest.mark.parametrize(
    ("fp32_s", "bf16_s", "chosen"),
    [(2.0, 1.0, BF16), (1.11, 1.0, BF16), (1.09, 1.0, FP32), (1.0, 1.0, FP32), (1.0, 3.0, FP32)],
)
def test_bf16_must_be_a_tenth_faster(fp32_s, bf16_s, chosen):
    choice = faster(fp32_s, bf16_s)
    assert (choice.precision, choice.fp32_s, choice.bf16_s) == (chosen, fp32_s, bf16_s)
    assert f"{fp32_s:.3g} s in fp32" in choice.reason


def test_the_least_of_each_counts(folder, probe_says):
    probe_says(fp32_s=2.0, bf16_s=1.0)
    choice = settled(folder)
    assert (choice.precision, choice.fp32_s, choice.bf16_s) == (BF16, 2.0, 1.0)


@pytest.mark.parametrize("native", [True, False])
def test_a_cpu_without_bf16_is_not_probed(folder, monkeypatch, native):
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: True)
    monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: native)
    monkeypatch.setattr(precision, "first_batch", lambda data: None)
    monkeypatch.setattr(precision, "step_seconds", lambda *_: {FP32: [3.0], BF16: [1.0]})
    choice = settled(folder)
    assert choice.precision == (BF16 if native else FP32)
    assert (choice.reason == "this CPU has no bf16 instructions") == (not native)


def test_a_device_that_is_neither_cpu_nor_cuda_takes_fp32():
    assert obstacle_to_bf16(torch.device("mps")) == "bf16 is not tried on mps"


def test_a_probe_that_fails_leaves_fp32(module, batch, monkeypatch):
    def forward(batch):
        if torch.is_autocast_enabled("cpu"):
            raise NotImplementedError('"bag" not implemented\nfor BFloat16')
        return OccupancyModule.forward(module, batch)

    monkeypatch.setattr(module, "forward", forward)
    choice = probed(module, batch, CPU)
    assert choice.precision == FP32
    assert '("bag" not implemented for BFloat16)' in choice.reason


# ---------------------------------------------------------------------------------------- the probe


def test_the_two_take_turns_and_the_first_turn_does_not_count(module, batch):
    seconds = step_seconds(module, batch, CPU, rounds=2)
    assert module.autocast == [False, True] * 3
    assert [len(times) for times in seconds.values()] == [2, 2]
    assert all(spent_s > 0 for times in seconds.values() for spent_s in times)


def test_a_slow_machine_takes_one_turn(module, batch):
    seconds = step_seconds(module, batch, CPU, limit_s=0)
    assert module.autocast == [False, True]
    assert [len(times) for times in seconds.values()] == [1, 1]


def test_every_step_begins_without_gradients(module, batch, monkeypatch):
    begun = []

    def forward(batch):
        begun.append(all(p.grad is None for p in module.parameters()))
        return OccupancyModule.forward(module, batch)

    monkeypatch.setattr(module, "forward", forward)
    step_seconds(module, batch, CPU, rounds=1)
    assert begun == [True] * 4


def test_training_after_a_probe_is_training_without_one(batch):
    undisturbed, asked = Watched(), Watched()
    torch.manual_seed(2)
    step_seconds(asked, batch, CPU, rounds=1)
    after = torch.rand(1)
    torch.manual_seed(2)
    assert torch.equal(after, torch.rand(1))
    assert all(p.grad is None for p in asked.parameters())
    ours, theirs = (training_step(module, batch) for module in (asked, undisturbed))
    assert len(ours) == len(theirs)
    assert all(map(torch.equal, ours, theirs))


def test_a_failed_probe_leaves_no_trace_either(batch, monkeypatch):
    """A GPU tells of what went wrong when it is waited for, with gradients in place."""
    undisturbed, asked = Watched(), Watched()

    def broken(device):
        if any(p.grad is not None for p in asked.parameters()):
            raise RuntimeError("out of something")

    monkeypatch.setattr(precision, "_finish_queued", broken)
    assert "out of something" in probed(asked, batch, CPU).reason
    assert all(p.grad is None for p in asked.parameters())
    ours, theirs = (training_step(module, batch) for module in (asked, undisturbed))
    assert all(map(torch.equal, ours, theirs))


def test_it_is_asked_with_the_first_batch_of_training(tmp_path):
    cfg = compose_config(*mini_overrides(tmp_path))
    data = data_of(cfg, write_dataset(cfg))
    state = torch.get_rng_state()
    ours = first_batch(data)
    assert torch.equal(torch.get_rng_state(), state)
    theirs = next(iter(data.train_dataloader()))
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        same = torch.equal(ours[name], value) if torch.is_tensor(value) else ours[name] == value
        assert same, name


# --------------------------------------------------------------------------------------- the record


def test_what_was_chosen_is_kept_whatever_a_later_probe_would_say(folder, probe_says):
    probe_says(fp32_s=2.0, bf16_s=1.0)
    first = settled(folder)
    record = json.loads((folder.path / "precision.json").read_text())
    assert set(record) == {"precision", "reason", "fp32_s", "bf16_s", "machine"}
    assert record["precision"] == BF16
    assert "cores" in record["machine"]
    probe_says(fp32_s=1.0, bf16_s=2.0)
    assert settled(folder) == first
    assert json.loads((folder.path / "precision.json").read_text()) == record


@pytest.mark.parametrize("named", [FP32, BF16])
def test_a_precision_that_is_named_is_taken_and_recorded(folder, probe_says, named):
    probe_says(fp32_s=1.5, bf16_s=1.5)
    choice = settled(folder, f"trainer.precision={named}")
    assert (choice.precision, choice.reason) == (named, "trainer.precision says so")
    record = json.loads((folder.path / "precision.json").read_text())
    assert (record["precision"], record["fp32_s"]) == (named, None)


def test_the_paper_s_scale_names_bf16(folder):
    assert settled(folder, "scale=paper").precision == BF16


@pytest.mark.parametrize("text", ["", "{}", '{"precision": "32-true"}', "[1]", '{"other": 1}'])
def test_a_broken_record_is_named(folder, text):
    (folder.path / "precision.json").write_text(text)
    with pytest.raises(UserError, match=r"precision\.json: cannot be read .* delete it") as info:
        settled(folder)
    assert "\n" not in str(info.value)


def test_a_checkpoint_is_scored_as_its_run_was_trained(folder, probe_says):
    cfg = compose_config()
    assert precision_of_run(cfg, folder.path) == FP32
    probe_says(fp32_s=2.0, bf16_s=1.0)
    settled(folder)
    assert precision_of_run(cfg, folder.path) == BF16
    assert precision_of_run(compose_config("trainer.precision=32-true"), folder.path) == FP32
