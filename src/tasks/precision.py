"""trainer.precision=auto: bf16 where a probe on this very machine finds it faster, else fp32."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import torch
from lightning import Trainer
from lightning.pytorch.plugins import MixedPrecision, Precision
from omegaconf import DictConfig

from ..data.batch import Batch
from ..data.datamodule import SkyShieldData
from ..errors import UserError
from ..models.module import OccupancyModule
from ..provenance import machine
from ..run_folder import RunFolder
from .processes import is_first_process

AUTO, FP32, BF16 = "auto", "32-true", "bf16-mixed"
RECORD = "precision.json"
WORTH = 1.1
"""How many times faster bf16 must be: it rounds, so a little gain is not worth it."""
ROUNDS, LIMIT_S = 3, 20.0


class Choice(NamedTuple):
    """The precision of a run and why; seconds of a training step where both were timed."""

    precision: str
    reason: str
    fp32_s: float | None = None
    bf16_s: float | None = None
    machine: str = ""


def settled_precision(
    cfg: DictConfig,
    folder: RunFolder,
    module: OccupancyModule,
    data: SkyShieldData,
    trainer: Trainer,
) -> Choice:
    """The precision of a run, chosen when it starts and kept in ``precision.json`` from then on.

    So a resumed run goes on as it began, on whatever machine. Several processes do not probe: each
    would have to know what the others found.
    """
    choice = recorded_choice(folder.path)
    if choice is None:
        device = trainer.strategy.root_device
        choice = _choose(cfg, module, data, device, trainer.world_size)
        choice = choice._replace(machine=machine_of(device))
        if is_first_process():
            folder.write_json(RECORD, choice._asdict())
    return choice


def precision_of_run(cfg: DictConfig, run: Path) -> str:
    """What a checkpoint of a run is scored with: a probe is for training alone."""
    if cfg.trainer.precision != AUTO:
        return cfg.trainer.precision
    choice = recorded_choice(run)
    return FP32 if choice is None else choice.precision


def recorded_choice(run: Path) -> Choice | None:
    """What the run's ``precision.json`` says; ``None`` without one. Raises `UserError`."""
    path = run / RECORD
    if not path.is_file():
        return None
    try:
        return Choice(**json.loads(path.read_text()))
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: cannot be read ({reason}); delete it to choose anew") from None


def _choose(
    cfg: DictConfig,
    module: OccupancyModule,
    data: SkyShieldData,
    device: torch.device,
    processes: int,
) -> Choice:
    if cfg.trainer.precision != AUTO:
        return Choice(cfg.trainer.precision, "trainer.precision says so")
    if processes > 1:
        return Choice(FP32, "several processes do not probe; trainer.precision chooses")
    obstacle = obstacle_to_bf16(device)
    if obstacle is not None:
        return Choice(FP32, obstacle)
    return probed(module, first_batch(data), device)


def obstacle_to_bf16(device: torch.device) -> str | None:
    """Why bf16 need not even be tried on a device; ``None`` where it computes in bf16."""
    if device.type == "cuda":
        native = torch.cuda.is_bf16_supported(including_emulation=False)
        return None if native else "this GPU has no bf16 instructions"
    if device.type != "cpu":
        return f"bf16 is not tried on {device.type}"
    # PyTorch's own test, of x86 and ARM alike; it also lets AVX-512 pass that only emulates bf16,
    # and there the probe decides.
    native = torch.backends.mkldnn.is_available() and torch.ops.mkldnn._is_mkldnn_bf16_supported()
    return None if native else "this CPU has no bf16 instructions"


def probed(module: OccupancyModule, batch: Batch, device: torch.device) -> Choice:
    """bf16 if a few training steps are enough faster with it; a failure counts as slow."""
    try:
        seconds = step_seconds(module, batch, device)
    except RuntimeError as error:  # training itself shall say what is wrong with fp32
        return Choice(FP32, f"the probe of bf16 failed ({' '.join(str(error).split())[:120]})")
    return faster(*(min(times) for times in seconds.values()))


def faster(fp32_s: float, bf16_s: float) -> Choice:
    """The rule, given the seconds of a training step with each."""
    found = f"a training step takes {fp32_s:.3g} s in fp32 and {bf16_s:.3g} s in bf16"
    return Choice(BF16 if fp32_s >= WORTH * bf16_s else FP32, found, fp32_s, bf16_s)


def step_seconds(
    module: OccupancyModule,
    batch: Batch,
    device: torch.device,
    rounds: int = ROUNDS,
    limit_s: float = LIMIT_S,
) -> dict[str, list[float]]:
    """Seconds of training steps without the optimizer's part, in fp32 and in bf16 by turns.

    The first turn, which also takes memory and chooses kernels, counts only where no other one was
    begun within ``limit_s``.
    The module and the random numbers are left as they were, so that training goes as it would have
    gone without; gradients are cleared.
    """
    # As the trainer would run them.
    contexts = {FP32: Precision(), BF16: MixedPrecision(BF16, device.type)}
    seconds = {precision: [] for precision in contexts}
    with _without_a_trace(module, device):
        batch = module.transfer_batch_to_device(batch, device, 0)
        end_s = time.perf_counter() + limit_s
        for turn in range(rounds + 1):
            if turn and time.perf_counter() > end_s:
                break
            for precision, context in contexts.items():
                seconds[precision].append(_step_s(module, batch, context))
    return {precision: times[1:] or times for precision, times in seconds.items()}


def first_batch(data: SkyShieldData) -> Batch:
    """The first batch of training, without starting the loader's workers."""
    loader = data.train_dataloader()
    keys = next(iter(loader.batch_sampler))
    return loader.collate_fn([loader.dataset[key] for key in keys])


def machine_of(device: torch.device) -> str:
    """What the seconds were measured on."""
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)}, {machine()}"
    return f"{machine()}, {torch.get_num_threads()} threads"


def _step_s(module: OccupancyModule, batch: Batch, context: Precision) -> float:
    _finish_queued(module.device)
    start_s = time.perf_counter()
    with context.forward_context():
        total = module.loss(module.training_logits(batch), batch["semantics"])["total"]
    total.backward()
    _finish_queued(module.device)
    spent_s = time.perf_counter() - start_s
    module.zero_grad()
    return spent_s


def _finish_queued(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


@contextmanager
def _without_a_trace(module: OccupancyModule, device: torch.device) -> Iterator[None]:
    """Restores the running statistics, the random numbers and the place of a module."""
    home = module.device
    before = {name: buffer.clone() for name, buffer in module.named_buffers()}
    try:
        with torch.random.fork_rng([device] if device.type == "cuda" else []):
            module.to(device)
            yield
    finally:
        module.zero_grad()
        module.to(home)
        for name, buffer in module.named_buffers():
            buffer.copy_(before[name])
