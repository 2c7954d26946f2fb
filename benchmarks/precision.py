"""Times training steps in fp32 and bf16 side by side: python -m benchmarks.precision scale=small.

Takes the overrides of run.py, needs a finished dataset, and prints the milliseconds of a step
without the optimizer's part, on a GPU where there is one, and their ratio. The two take turns, so
that whatever else the machine does meets both. It asserts nothing.
"""

import sys
from collections.abc import Callable
from functools import partial

from hydra.utils import instantiate
from lightning.fabric.utilities import move_data_to_device
from lightning.pytorch.plugins import MixedPrecision, Precision

from benchmarks.settings import composed_with_data, device, run
from benchmarks.tables import print_costs
from src.ontology import NUM_CLASSES
from src.tasks.trainer import BF16, FP32

ROUNDS = 10


def steps(overrides: list[str]) -> dict[str, Callable[[], None]]:
    """Returns a training step in each precision."""
    cfg, data = composed_with_data(overrides)
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
    return {name: partial(step, precision) for name, precision in precisions.items()}


def main() -> None:
    overrides = sys.argv[1:]
    print_costs(f"{' '.join(overrides)}: a training step", steps(overrides), ROUNDS)


if __name__ == "__main__":
    run(main)
