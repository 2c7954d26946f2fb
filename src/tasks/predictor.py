"""A trained model as a function of the loader's batches."""

from collections.abc import Callable

import lightning
import torch
from jaxtyping import Float
from torch import Tensor

from ..data.batch import Batch
from ..models.network import SkyOcc

Predictor = Callable[[Batch], Float[Tensor, "b 9 x y z"]]


def predictor(network: SkyOcc, trainer: lightning.Trainer) -> Predictor:
    """Returns the function from a batch to its logits in float32, which are computed on the
    trainer's device and in its precision."""
    # Under the trainer's own context, so that a prediction has the bits of its scores.
    network.to(trainer.strategy.root_device).eval()

    @torch.no_grad()
    def logits(batch: Batch) -> Float[Tensor, "b 9 x y z"]:
        with trainer.precision_plugin.forward_context():
            return network(on_device(batch, network.device)).float()

    return logits


def on_device(batch: Batch, device: torch.device) -> Batch:
    """Moves the tensors of a batch to a device."""
    return {
        key: value.to(device) if isinstance(value, Tensor) else value
        for key, value in batch.items()
    }
