"""What a frame costs in flight: latency and memory of a stream, and of computing the queue anew.

    python -m benchmarks.inference scale=small [--threads 2] [--exported]

Takes the overrides of run.py and needs the data set to be there; a stream flies through noise, and
the weights are untrained (neither changes the cost). On a GPU where there is one, in bf16 as well.
With ``--exported`` the graphs of task=export run too (on the CPU). All take turns. Prints
milliseconds a frame, frames a second, the ratio to computing the queue anew, and the memory that a
frame takes beyond the model; asserts nothing.
"""

import argparse
import statistics
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table

from benchmarks.timing import extra_mib, milliseconds
from src.failures import quiet_libraries, told_in_one_line
from src.models.export import FORMATS, ExportedStep, export_step
from src.models.network import SkyOcc
from src.models.stream import SkyOccStream
from src.provenance import machine
from src.tasks.dataset import data_of, finished_dataset
from src.tasks.export import made_up_flight

ROUNDS, WARM_UP = 12, 4


def contenders(cfg: DictConfig, exported: bool, folder: Path) -> dict[str, Callable[[], object]]:
    """What is timed, by name; each call takes the next frame."""
    data = data_of(cfg, finished_dataset(cfg))
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network: SkyOcc = instantiate(cfg.model).to(device).eval()
    # Each is called once to warm up and once for its memory besides.
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    frames = made_up_flight(sim, WARM_UP + ROUNDS + 2, cfg.data.history_step_s)
    batch = next(iter(data.in_order("test")))
    window = {k: v[-1:].to(device) for k, v in batch.items() if isinstance(v, torch.Tensor)}
    window["history_valid"] = torch.ones_like(window["history_valid"])
    anew = torch.no_grad()(lambda: network(window))
    stream_of = partial(SkyOccStream, history_step_s=cfg.data.history_step_s)

    def flight(network: SkyOcc | ExportedStep) -> Callable[[], object]:
        stream, coming = stream_of(network), iter(frames)
        for _ in range(WARM_UP):
            stream(next(coming))
        return lambda: stream(next(coming))

    todo = {"the queue anew": anew, "a stream": flight(network)}
    if device.type == "cuda":
        bf16 = torch.autocast("cuda", torch.bfloat16)
        todo |= {"the queue anew, bf16": bf16(anew), "a stream, bf16": bf16(flight(network))}
    if exported:
        arguments = stream_of(network.cpu()).arguments(frames[0])
        export_step(network, *arguments, folder, FORMATS, {})
        network.to(device)
        for name in FORMATS:
            step = ExportedStep(folder, name, torch.get_num_threads())
            todo[f"a stream, {FORMATS[name]}"] = flight(step)
    return todo


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("overrides", nargs="+")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--exported", action="store_true")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    conf = Path(__file__).parent.parent / "conf"
    with initialize_config_dir(str(conf.resolve()), version_base="1.3"):
        cfg = compose("config", overrides=options.overrides)
    with tempfile.TemporaryDirectory() as folder:
        todo = contenders(cfg, options.exported, Path(folder))
        spent_ms = milliseconds(todo, ROUNDS)
        memory = {name: extra_mib(measure) for name, measure in todo.items()}
    where = torch.cuda.get_device_name() if torch.cuda.is_available() else machine()
    table = Table(title=f"scale {cfg.scale_name}, {where}, {options.threads} thread(s)")
    for column in ("a frame by", "median ms", "min ms", "frames/s", "times", "MiB"):
        table.add_column(column, justify="left" if column == "a frame by" else "right")
    anew = statistics.median(spent_ms["the queue anew"])
    for name, times in spent_ms.items():
        median = statistics.median(times)
        cells = (median, min(times), 1e3 / median, anew / median, memory[name])
        table.add_row(name, *(f"{cell:.{d}f}" for cell, d in zip(cells, (1, 1, 1, 2, 0))))
    Console(width=100).print(table)


if __name__ == "__main__":
    quiet_libraries()
    with told_in_one_line():
        main()
