"""Times training steps in fp32 and bf16 side by side: python -m benchmarks.precision scale=small.

Takes the overrides of run.py, needs a finished dataset, and prints the milliseconds of a step
without the optimizer's part, on a GPU where there is one, and their ratio. The two take turns, so
that whatever else the machine does meets both. It asserts nothing.
"""

import statistics
import sys
from functools import partial

from hydra.utils import instantiate
from lightning.fabric.utilities import move_data_to_device
from lightning.pytorch.plugins import MixedPrecision, Precision
from rich.markup import escape

from benchmarks.settings import composed, device, device_name, run
from benchmarks.tables import print_table
from benchmarks.timing import milliseconds
from src.ontology import NUM_CLASSES
from src.tasks.dataset import data_of, finished_dataset
from src.tasks.trainer import BF16, FP32

ROUNDS = 10


def measure(overrides: list[str]) -> dict[str, list[float]]:
    """Returns the milliseconds of every step by precision."""
    cfg = composed(overrides)
    data = data_of(cfg, finished_dataset(cfg))
    network = instantiate(cfg.model).to(device())
    loss = instantiate(cfg.loss, class_counts=[1] * NUM_CLASSES).to(device())
    batch = move_data_to_device(next(iter(data.train_dataloader())), device())

    # The optimizer's part is the same in both, so it is left out.
    def step(precision: Precision) -> None:
        with precision.forward_context():
            total = loss(network(batch), batch["semantics"])["total"]
        total.backward()
        network.zero_grad()

    precisions = {FP32: Precision(), BF16: MixedPrecision(BF16, device().type)}
    steps = {name: partial(step, precision) for name, precision in precisions.items()}
    return milliseconds(steps, ROUNDS)


def main() -> None:
    spent_ms, rows = measure(sys.argv[1:]), []
    fp32_ms = min(spent_ms[FP32]), statistics.median(spent_ms[FP32])
    for precision, times_ms in spent_ms.items():
        step_ms = min(times_ms), statistics.median(times_ms)
        speeds = (f"{fp32 / spent:.2f}" for fp32, spent in zip(fp32_ms, step_ms))
        rows.append((precision, *(f"{spent:.0f}" for spent in step_ms), *speeds))

    title = f"{escape(' '.join(sys.argv[1:]))}: {ROUNDS} training steps each, by turns"
    columns = ("precision", "min ms", "median ms", "speed, min", "speed, median")
    print_table(f"{title}; {device_name()}", columns, rows)


if __name__ == "__main__":
    run(main)
