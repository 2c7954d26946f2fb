"""Times one training step on real frames: python benchmarks/training_step.py scale=small.

Takes the overrides of run.py, needs the data set to be there, and prints samples per second, the
share of each stage, and the peak memory. It asserts nothing.
"""

import resource
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))

from src.failures import told_in_one_line
from src.models.losses import OccupancyLoss
from src.ontology import NUM_CLASSES
from src.provenance import machine
from src.tasks.dataset import data_of, ready_dataset

STEPS = 10

Seconds = dict[str, float]


@contextmanager
def timed(seconds: Seconds, stage: str) -> Iterator[None]:
    start_s = time.perf_counter()
    yield
    seconds[stage] += time.perf_counter() - start_s


def measure(overrides: list[str]) -> tuple[Seconds, int]:
    """Seconds of every stage over STEPS steps, and the batch size."""
    conf = Path(__file__).parent.parent / "conf"
    with initialize_config_dir(str(conf.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=overrides)
    data = data_of(cfg, ready_dataset(cfg))
    network = instantiate(cfg.model)
    loss = OccupancyLoss(torch.ones(NUM_CLASSES), lovasz_weight=1.0)
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-4)
    batches = iter(data.train_dataloader())
    seconds: Seconds = defaultdict(float)
    for step in range(STEPS + 1):
        spent = seconds if step else defaultdict(float)
        with timed(spent, "waiting for the loader"):
            batch = next(batches)
        with timed(spent, "forward"):
            logits = network(batch)
        with timed(spent, "loss"):
            total = loss(logits, batch["semantics"])["total"]
        with timed(spent, "backward"):
            total.backward()
        with timed(spent, "optimizer"):
            optimizer.step()
            optimizer.zero_grad()
    return seconds, cfg.data.batch_size


def main() -> None:
    seconds, batch_size = measure(sys.argv[1:])
    total_s = sum(seconds.values())
    table = Table(title=f"{' '.join(sys.argv[1:])}: {STEPS * batch_size / total_s:.1f} samples/s")
    table.add_column("stage")
    table.add_column("ms a step", justify="right")
    table.add_column("share", justify="right")
    for stage, spent_s in seconds.items():
        table.add_row(stage, f"{1e3 * spent_s / STEPS:.0f}", f"{100 * spent_s / total_s:.0f} %")
    console = Console()
    console.print(table)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    threads = torch.get_num_threads()
    console.print(f"peak memory {peak_mib:.0f} MiB; {machine()}, {threads} threads")


if __name__ == "__main__":
    with told_in_one_line():
        main()
