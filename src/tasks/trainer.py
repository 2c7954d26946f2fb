"""Lightning's trainer as configured: its device, its precision, and the lines that it prints."""

import os
import signal
import threading
from collections.abc import Callable

import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from jaxtyping import Float
from lightning import Trainer
from lightning.fabric.plugins.environments import SLURMEnvironment, TorchElasticEnvironment
from lightning.fabric.utilities import move_data_to_device
from lightning.pytorch.utilities import rank_zero_only
from omegaconf import DictConfig
from torch import Tensor

from ..data.batch import Batch
from ..errors import UserError
from ..heap import keep_freed_memory
from ..models.network import SkyOcc

AUTO, FP32, BF16, FP16 = "auto", "32-true", "bf16-mixed", "16-mixed"
Predictor = Callable[[Batch], Float[Tensor, "b 9 x y z"]]


def trainer_of(cfg: DictConfig) -> Trainer:
    """Builds the trainer with the configured callbacks and logger, in the precision that
    `precision_of` says.

    Raises `UserError` for a device or a precision that is not to be had.
    """
    precision = precision_of(cfg)
    keep_freed_memory()
    if cfg.threads is not None:
        torch.set_num_threads(cfg.threads)

    try:
        trainer = instantiate(
            cfg.trainer,
            precision=precision,
            plugins=[*instantiate(cfg.trainer.plugins), *_slurm()],
            callbacks=list(instantiate(cfg.callbacks).values()),
            logger=instantiate(cfg.logger),
        )
    except (InstantiationException, RuntimeError) as error:
        reason = " ".join(str(error.__cause__ or error).split())
        raise UserError(f"trainer: {reason}; see conf/trainer/default.yaml") from error

    # A rank that the environment names is another program's, where this run has one process.
    rank_zero_only.rank = trainer.global_rank
    return trainer


def _slurm() -> list[SLURMEnvironment]:
    """Returns Lightning's environment of a Slurm job, without its requeueing.

    Lightning would keep weights of its own in the folder of the run, and score those ever after.
    The run goes on from its last checkpoint anyway. So the signal that asks for a requeue ends the
    program in good order, as SIGTERM does.
    """
    # In the order in which Lightning looks for them.
    if TorchElasticEnvironment.detect() or not SLURMEnvironment.detect():
        return []
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGUSR1, lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    return [SLURMEnvironment(auto_requeue=False)]


def precision_of(cfg: DictConfig) -> str:
    """Returns ``trainer.precision``; where it is ``auto``, ``gpu_precision`` on a CUDA GPU, else
    fp32.

    Raises `UserError` for a precision that the device does not compute in as it is named, and as
    `kind_of_device` does.
    """
    kind = kind_of_device(cfg.trainer.accelerator)
    asked = cfg.trainer.precision
    if asked == AUTO:
        asked = cfg.gpu_precision if kind == "cuda" else FP32

    # Older GPUs only emulate bf16, more slowly than they compute in fp32.
    runs = {"cpu": (FP32, BF16), "mps": (FP32,), "cuda": (FP32, FP16)}[kind]
    if kind == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        runs = (*runs, BF16)

    if asked not in runs:
        raise UserError(
            f"trainer.precision: a {kind} device here does not compute in {asked}; give "
            f"{' or '.join(runs)}"
        )
    return asked


def kind_of_device(accelerator: str) -> str:
    """Returns ``cuda``, ``mps`` or ``cpu``: what ``trainer.accelerator`` means on this machine.

    Raises `UserError` for one that is not there.
    """
    available = {"mps": torch.backends.mps.is_available(), "cuda": torch.cuda.is_available()}
    kinds = [*(kind for kind, is_available in available.items() if is_available), "cpu"]
    wanted = {"auto": kinds, "gpu": ["mps", "cuda"]}.get(accelerator, [accelerator])

    for kind in kinds:
        if kind in wanted:
            return kind
    raise UserError(
        f"trainer.accelerator: {accelerator}, but PyTorch finds only {', '.join(kinds)} here; give "
        "one of these, or auto"
    )


def is_first_process() -> bool:
    """Tells whether this process prints and writes files; the others only compute.

    Known before a trainer exists: whoever starts the processes numbers them in the environment.
    The trainer corrects that (`trainer_of`).
    """
    # Lightning sets the rank when it is imported, from what its launcher left there.
    return getattr(rank_zero_only, "rank", 0) == 0


def predictor(network: SkyOcc, trainer: Trainer) -> Predictor:
    """Returns the function from a loader's batch to its logits in float32, which are computed on
    the trainer's device and in its precision."""
    # Under the trainer's own context, so that a prediction has the bits of its scores.
    network.to(trainer.strategy.root_device).eval()

    @torch.no_grad()
    def logits(batch: Batch) -> Float[Tensor, "b 9 x y z"]:
        with trainer.precision_plugin.forward_context():
            return network(move_data_to_device(batch, network.device)).float()

    return logits
