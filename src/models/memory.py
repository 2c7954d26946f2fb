"""What earlier steps of a training left behind, as the history of the next one."""

from collections import deque
from collections.abc import Mapping

from jaxtyping import Float
from torch import Tensor

from .history import History


class PillarMemory:
    """Keeps the pillars of the last ``length`` steps, whose batches were consecutive frames.

    Each place of the batch is a stream of its own (`data.batches.StreamBatches`). The batch's
    ``history_valid`` says how far back it goes. The weights change between the steps, so older
    pillars are those of older weights: the price of not computing them again.
    """

    def __init__(self, length: int) -> None:
        self.steps: deque[Tensor] = deque(maxlen=length)

    def clear(self) -> None:
        """Forgets everything: at the start of an epoch."""
        self.steps.clear()

    def keep(self, pillars: Float[Tensor, "b p dim"]) -> None:
        """Keeps what a step left behind, without its graph."""
        self.steps.append(pillars.detach())

    def history(self, batch: Mapping[str, Tensor]) -> History | None:
        """Returns the history of a batch's current frames; ``None`` where nothing is kept.

        Raises `RuntimeError` where the batch relies on steps that were never taken.
        """
        kept = len(self.steps)
        older = batch["history_valid"][:, : -1 - kept]
        if kept < self.steps.maxlen and older.any():
            raise RuntimeError("a batch of a stream refers to steps that were never taken")
        return History.of(self.steps, batch) if kept else None
