"""The time of a training step by stage.

    python -m studies.speed.training_step scale=small [--steps 12]

Takes the overrides of run.py and needs a finished dataset: real frames, through the loader of
training, with ``data.order=streams`` as well. On a GPU where there is one, in the precision of the
configuration there. Prints samples per second, the share of each stage, the peak memory, and how
often a step makes the host wait for a GPU, which a simulated one counts; asserts nothing.
"""

import resource
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext

import torch
from hydra.utils import instantiate
from lightning.fabric.utilities import move_data_to_device
from omegaconf import DictConfig
from torch import Tensor

from src.models.history import PillarMemory
from src.models.network import SkyOcc
from src.models.sight import Sight
from src.ontology import NUM_CLASSES
from src.provenance import git_commit
from src.tasks.trainer import BF16, precision_of
from studies.settings import composed_with_data, device, device_name, run
from studies.speed.timing import timed
from studies.tables import print_table
from tests.simulated_cuda import CUDA, simulated_cuda

WARM_UP = 2

Seconds = dict[str, float]


class Step:
    """One training step of a network, stage by stage."""

    def __init__(self, cfg: DictConfig, device: torch.device) -> None:
        self.network: SkyOcc = instantiate(cfg.model).to(device)
        self.loss = instantiate(cfg.loss, class_counts=[1] * NUM_CLASSES).to(device)
        self.optimizer = instantiate(cfg.optimizer.rule)(self.network.parameters(), lr=1e-4)
        self.memory, self.device = None, device
        # With streams, past frames come from the memory of earlier steps.
        if cfg.data.order == "streams":
            self.memory = PillarMemory(self.network.past_frames)
        self.bf16 = precision_of(cfg) == BF16

    def precision(self) -> AbstractContextManager:
        return torch.autocast(self.device.type, torch.bfloat16) if self.bf16 else nullcontext()

    def __call__(self, batch: Mapping[str, Tensor], seconds: Seconds) -> None:
        with self.precision():
            logits, sight = self.forward(batch, seconds)
        with timed(seconds, "losses"):
            total = self.loss(logits, batch["semantics"])["total"]
            if sight is not None:
                total = total + sum(self.network.sight.losses(sight, batch).values())
        with timed(seconds, "backward"):
            total.backward()
        with timed(seconds, "optimizer"):
            self.optimizer.step()
            self.optimizer.zero_grad()

    def forward(self, batch: Mapping[str, Tensor], seconds: Seconds) -> tuple[Tensor, Sight | None]:
        network = self.network
        with timed(seconds, "past frames"):
            past = network.history_of if self.memory is None else self.memory.history
            history = past(batch)
        with timed(seconds, "the frame by itself"):
            frame = network.encode(batch, -1)
        with timed(seconds, "history and last layer"):
            fused = network.fuse(frame, history)
        if self.memory is not None:
            self.memory.keep(network.carried(frame, fused))
        with timed(seconds, "decoder"):
            return network.decode(fused, batch), frame.sight


def measure(overrides: Sequence[str], steps: int) -> tuple[DictConfig, Seconds, str]:
    """Returns configuration, seconds of every stage over all steps, and the machine."""
    cfg, data = composed_with_data(overrides)
    step = Step(cfg, device())
    batches = iter(data.train_dataloader())
    seconds: Seconds = defaultdict(float)
    # The first steps take memory and compile, and are not counted.
    for number in range(WARM_UP + steps):
        spent = seconds if number >= WARM_UP else defaultdict(float)
        with timed(spent, "waiting for the loader"):
            batch = next(batches)
        with timed(spent, "to the device"):
            batch = move_data_to_device(batch, device())
        step(batch, spent)

    where = f"{BF16 if step.bf16 else 'fp32'}, {device_name()}, peak memory {peak_mib():.0f} MiB"
    waits = waits_of_step(cfg, next(batches))
    return cfg, seconds, f"{where}; {waits.total()} waits for a GPU: {dict(waits)}"


def peak_mib() -> float:
    """Returns the peak memory of the GPU where there is one, otherwise of the process."""
    if torch.cuda.is_available():
        return torch.cuda.max_memory_allocated() / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def waits_of_step(cfg: DictConfig, batch: Mapping[str, Tensor]) -> Counter[str]:
    """Returns the operations of a training step that would make the host wait for a GPU."""
    with simulated_cuda() as waits:
        Step(cfg, CUDA)(move_data_to_device(batch, CUDA), defaultdict(float))
        return waits.copy()


def main(*overrides: str, steps: int = 12) -> None:
    cfg, seconds, where = measure(overrides, steps)
    total_s = sum(seconds.values())
    rate = steps * cfg.data.batch_size / total_s
    rows = [
        (stage, f"{1e3 * spent_s / steps:.0f}", f"{100 * spent_s / total_s:.1f} %")
        for stage, spent_s in seconds.items()
    ]

    title = f"scale {cfg.scale_name}, {cfg.data.order}, batch {cfg.data.batch_size}"
    columns, notes = ("stage", "ms a step", "share"), [f"{where}, commit {git_commit()}"]
    print_table(f"{title}: {rate:.2f} samples/s", columns, rows, notes)


if __name__ == "__main__":
    run(main)
