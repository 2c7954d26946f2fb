"""Runs of several processes: which of them speaks and writes."""

import torch
from lightning.pytorch.utilities import rank_zero_only


def is_first_process() -> bool:
    """Tells whether this process prints and writes files; the others only compute.

    Known before a trainer exists: whoever starts the processes numbers them in the environment.
    """
    # Lightning sets the rank when it is imported, from what its launcher left there.
    return getattr(rank_zero_only, "rank", 0) == 0


def part_company() -> None:
    """Ends the work that processes share; what follows is the first one's alone.

    A metric that counts there would otherwise wait for the others.
    """
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()
