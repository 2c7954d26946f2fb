"""Times training steps in fp32 and bf16 side by side: python -m benchmarks.precision scale=small.

Takes the overrides of run.py, needs the data set to be there, and prints the milliseconds of a step
without the optimizer's part, on a GPU where there is one, and their ratio. The two take turns, so
that whatever else the machine does meets both. It asserts nothing.
"""

import statistics
import sys
from functools import partial
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from lightning.pytorch.plugins import MixedPrecision, Precision
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.timing import milliseconds
from src.failures import quiet_libraries, told_in_one_line
from src.models.losses import OccupancyLoss
from src.ontology import NUM_CLASSES
from src.provenance import machine
from src.tasks.dataset import data_of, finished_dataset
from src.tasks.predictor import on_device
from src.tasks.trainer import BF16, FP32

ROUNDS = 10


def measure(overrides: list[str]) -> tuple[dict[str, list[float]], str]:
    """Milliseconds of every step by precision, and on what."""
    conf = Path(__file__).parent.parent / "conf"
    with initialize_config_dir(str(conf.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=overrides)
    data = data_of(cfg, finished_dataset(cfg))
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = instantiate(cfg.model).to(device)
    loss = OccupancyLoss(torch.ones(NUM_CLASSES), lovasz_weight=1.0).to(device)
    batch = on_device(next(iter(data.train_dataloader())), device)

    def step(precision: Precision) -> None:
        with precision.forward_context():
            total = loss(network(batch), batch["semantics"])["total"]
        total.backward()
        network.zero_grad()

    precisions = {FP32: Precision(), BF16: MixedPrecision(BF16, device.type)}
    where = torch.cuda.get_device_name() if device.type == "cuda" else machine()
    steps = {name: partial(step, precision) for name, precision in precisions.items()}
    return milliseconds(steps, ROUNDS), f"{where}, {torch.get_num_threads()} threads"


def main() -> None:
    spent_ms, where = measure(sys.argv[1:])
    table = Table(title=f"{escape(' '.join(sys.argv[1:]))}: {ROUNDS} training steps each, by turns")
    table.add_column("precision")
    for name in ("min ms", "median ms", "speed, min", "speed, median"):
        table.add_column(name, justify="right")
    fp32_ms = min(spent_ms[FP32]), statistics.median(spent_ms[FP32])
    for precision, times in spent_ms.items():
        of_steps = min(times), statistics.median(times)
        speeds = (f"{fp32 / spent:.2f}" for fp32, spent in zip(fp32_ms, of_steps))
        table.add_row(precision, *(f"{spent:.0f}" for spent in of_steps), *speeds)
    console = Console()
    console.print(table)
    console.print(where)


if __name__ == "__main__":
    quiet_libraries()
    with told_in_one_line():
        main()
