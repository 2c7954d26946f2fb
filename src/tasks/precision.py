"""What a run computes on, and in which precision: by configuration and kind of device alone."""

import torch
from omegaconf import DictConfig

from ..errors import UserError

AUTO, FP32, BF16, FP16 = "auto", "32-true", "bf16-mixed", "16-mixed"


def kind_of_device(accelerator: str) -> str:
    """``cuda``, ``mps`` or ``cpu``: what ``trainer.accelerator`` means on this machine.

    Raises `UserError` for one that is not there.
    """
    found = {"mps": torch.backends.mps.is_available(), "cuda": torch.cuda.is_available()}
    there = [*(kind for kind, is_there in found.items() if is_there), "cpu"]
    wanted = {"auto": there, "gpu": ["mps", "cuda"]}.get(accelerator, [accelerator])
    if kinds := [kind for kind in there if kind in wanted]:
        return kinds[0]
    raise UserError(
        f"trainer.accelerator: {accelerator}, but PyTorch finds only {', '.join(there)} here; give "
        "one of these, or auto"
    )


def precision_of(cfg: DictConfig) -> str:
    """``trainer.precision``; where it is ``auto``, ``gpu_precision`` on a CUDA GPU, else fp32.

    Raises `UserError` for a precision that the device does not compute in as it is named, and as
    `kind_of_device` does.
    """
    kind = kind_of_device(cfg.trainer.accelerator)
    asked = cfg.trainer.precision
    if asked == AUTO:
        asked = cfg.gpu_precision if kind == "cuda" else FP32

    runs = {"cpu": (FP32, BF16), "mps": (FP32,), "cuda": (FP32, FP16)}[kind]
    if kind == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        runs = (*runs, BF16)
    if asked not in runs:
        raise UserError(
            f"trainer.precision: a {kind} device here does not compute in {asked}; give "
            f"{' or '.join(runs)}"
        )
    return asked
