"""Times training steps in fp32 and bf16 side by side: python -m benchmarks.precision scale=small.

Takes the overrides of run.py, needs the data set to be there, and prints the seconds of a step
without the optimizer's part, on the device that training would use, and their ratio. The two take
turns, so that whatever else the machine does meets both. It asserts nothing.
"""

import math
import statistics
import sys
from pathlib import Path

from hydra import compose, initialize_config_dir
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from src.failures import quiet_libraries, told_in_one_line
from src.tasks.dataset import data_of, ready_dataset
from src.tasks.fit import trainer_of
from src.tasks.model import module_of, prior_of
from src.tasks.precision import FP32, first_batch, machine_of, obstacle_to_bf16, step_seconds

ROUNDS = 10


def measure(overrides: list[str]) -> tuple[dict[str, list[float]], str]:
    """Seconds of every step by precision, and on what."""
    conf = Path(__file__).parent.parent / "conf"
    with initialize_config_dir(str(conf.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=overrides)
    data = data_of(cfg, ready_dataset(cfg))
    module = module_of(cfg, data, prior_of(cfg, data))
    device = trainer_of(cfg, FP32).strategy.root_device
    seconds = step_seconds(module, first_batch(data), device, ROUNDS, math.inf)
    return seconds, f"{machine_of(device)}; {obstacle_to_bf16(device) or 'bf16 is native'}"


def main() -> None:
    seconds, where = measure(sys.argv[1:])
    table = Table(title=f"{escape(' '.join(sys.argv[1:]))}: {ROUNDS} training steps each, by turns")
    table.add_column("precision")
    for name in ("min ms", "median ms", "speed, min", "speed, median"):
        table.add_column(name, justify="right")
    fp32_s, bf16_s = ((min(times), statistics.median(times)) for times in seconds.values())
    for precision, spent_s in zip(seconds, (fp32_s, bf16_s)):
        milliseconds = (f"{1e3 * spent:.0f}" for spent in spent_s)
        speeds = (f"{fp32 / spent:.2f}" for fp32, spent in zip(fp32_s, spent_s))
        table.add_row(precision, *milliseconds, *speeds)
    console = Console()
    console.print(table)
    console.print(where)


if __name__ == "__main__":
    quiet_libraries()
    with told_in_one_line():
        main()
