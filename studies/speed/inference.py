"""The cost of a frame in flight: a stream, and computing the queue anew, in time and memory.

    python -m studies.speed.inference scale=small [--threads 2] [--exported]

Takes the overrides of run.py and needs a finished dataset; a stream flies through noise, and
the weights are untrained (neither changes the cost). On a GPU where there is one, in bf16 as well.
With ``--exported`` the graphs of task=export run too (on the CPU). All take turns. Prints
milliseconds a frame, frames a second, the ratio to computing the queue anew, and the memory that a
frame takes beyond the model; asserts nothing.
"""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from src.data.datamodule import SkyShieldData
from src.models.export import FORMATS, ExportedStep, export_step
from src.models.network import SkyOcc
from src.models.stream import SkyOccStream
from src.tasks.export import made_up_flight
from studies.settings import composed_with_data, device, run
from studies.speed.timing import print_costs

ROUNDS, WARM_UP = 12, 4


def contenders(
    cfg: DictConfig, data: SkyShieldData, exported: bool, folder: Path
) -> dict[str, Callable[[], object]]:
    """Returns the measures by name; each call takes the next frame."""
    network: SkyOcc = instantiate(cfg.model).to(device()).eval()
    # Each is called once to warm up and once for its memory besides.
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    frames = made_up_flight(sim, WARM_UP + ROUNDS + 2, cfg.data.history_step_s)

    batch = next(iter(data.in_order("test")))
    window = {k: v[-1:].to(device()) for k, v in batch.items() if isinstance(v, torch.Tensor)}
    window["history_valid"] = torch.ones_like(window["history_valid"])

    # The whole queue is computed for every frame, as training does; a stream keeps past frames.
    anew = torch.no_grad()(lambda: network(window))
    stream_of = partial(SkyOccStream, history_step_s=cfg.data.history_step_s)

    def flight(network: SkyOcc | ExportedStep) -> Callable[[], object]:
        stream, coming = stream_of(network), iter(frames)
        for _ in range(WARM_UP):
            stream(next(coming))
        return lambda: stream(next(coming))

    measures = {"the queue anew": anew, "a stream": flight(network)}
    if device().type == "cuda":
        bf16 = torch.autocast("cuda", torch.bfloat16)
        measures |= {"the queue anew, bf16": bf16(anew), "a stream, bf16": bf16(flight(network))}
    if exported:
        arguments = stream_of(network.cpu()).arguments(frames[0])
        export_step(network, *arguments, folder, FORMATS, {})
        network.to(device())
        for name in FORMATS:
            step = ExportedStep(folder, name, torch.get_num_threads())
            measures[f"a stream, {FORMATS[name]}"] = flight(step)
    return measures


def main(*overrides: str, threads: int = torch.get_num_threads(), exported: bool = False) -> None:
    torch.set_num_threads(threads)
    cfg, data = composed_with_data(overrides)
    with tempfile.TemporaryDirectory() as folder:
        measures = contenders(cfg, data, exported, Path(folder))
        print_costs(f"a frame at scale {cfg.scale_name}", measures, ROUNDS)


if __name__ == "__main__":
    run(main)
