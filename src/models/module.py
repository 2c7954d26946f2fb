"""Steps and logging of the training; the network, the loss and the scores come from outside."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import torch
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR
from torchmetrics import MeanMetric, Metric

from ..data.truth import truth_of
from ..errors import UserError
from .checkpoint import FORMAT, Origin
from .history import PillarMemory
from .network import Step
from .sight import depth_error
from .weights import ORIGIN


class OccupancyModule(LightningModule):
    """Trains a network that maps a batch to occupancy logits, and scores it.

    ``test_suite`` counts the predictions on the test split. With a ``memory`` the training batches
    are consecutive frames, and what a step computed of them is the history of the next one.
    ``origin`` is kept in every checkpoint. Raises `UserError` when a loss is not finite: in
    training before the weights are touched, in validation before they are saved.
    """

    def __init__(
        self,
        network: nn.Module,
        loss: nn.Module,
        make_scores: Callable[[], Metric],
        optimizer: Mapping[str, Any],
        test_suite: nn.Module,
        memory: PillarMemory | None = None,
        origin: Origin | None = None,
    ) -> None:
        super().__init__()
        self.network, self.loss = network, loss
        self.val_scores, self.test_suite = make_scores(), test_suite
        self.val_depth = MeanMetric()
        self.memory, self.origin = memory, origin
        self.optimizer_config = dict(optimizer)

    def forward(self, batch: Mapping[str, Tensor]) -> Tensor:
        return self.network(batch)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Adds what makes the file stand alone, for `Checkpoint` to read."""
        if self.origin is not None:
            backbone = getattr(self.network.backbone, "built_by", {})
            checkpoint[ORIGIN] = {**vars(self.origin), "format": FORMAT, "backbone": backbone}

    def on_train_epoch_start(self) -> None:
        if self.memory is not None:
            self.memory.clear()

    def training_step(self, batch: Mapping[str, Tensor], batch_index: int) -> Tensor:
        step = self.training_output(batch)
        parts = self.loss(step.logits, batch["semantics"])
        if step.sight is not None:
            of_pixels = self.network.sight.losses(step.sight, batch)
            parts |= of_pixels | {"total": parts["total"] + sum(of_pixels.values())}
        # Here, and not after the step: no weight is touched by a loss that is not finite.
        self._require_finite(parts, batch)
        self.log_dict({f"train/{name}": value.detach() for name, value in parts.items()})
        self.log("train/loss", parts["total"].detach(), prog_bar=True, logger=False)
        return parts["total"]

    def training_output(self, batch: Mapping[str, Tensor]) -> Step:
        """Runs the network on a batch of the training loader, shuffled or of streams."""
        if self.memory is None:
            return self.network.step(batch, self.network.history_of(batch))

        step = self.network.step(batch, self.memory.history(batch))
        self.memory.keep(step.pillars)
        return step

    def validation_step(self, batch: Mapping[str, Tensor], batch_index: int) -> None:
        logits, _, sight = self.network.step(batch, self.network.history_of(batch))
        parts = self.loss(logits, batch["semantics"])
        self._require_finite(parts, batch)
        self.log("val/loss", parts["total"], batch_size=len(batch["frame"]), sync_dist=True)
        self.val_scores.update(logits, batch["semantics"], batch["velocity_mps"])
        if sight is not None:
            self.val_depth.update(*depth_error(sight, batch["pixel_depth_m"]))

    def on_validation_epoch_end(self) -> None:
        scores = self.val_scores.compute()
        self.val_scores.reset()
        self.log_dict({f"val/{name}": value for name, value in scores.items()})
        self.log("val/kar", scores["kar_miou"], prog_bar=True, logger=False)
        if self.val_depth.update_called:
            self.log("val/depth_error", self.val_depth.compute())
            self.val_depth.reset()

    def monitored(self) -> list[str]:
        """Returns the names of what is logged by the end of a validation, to choose weights by."""
        scores = self.val_scores.compute()
        self.val_scores.reset()
        depth = [] if self.network.sight is None else ["val/depth_error"]
        return ["train/loss", "val/loss", "val/kar", *depth, *(f"val/{name}" for name in scores)]

    def test_step(self, batch: Mapping[str, Tensor], batch_index: int) -> None:
        self.test_suite.update(self(batch), truth_of(batch))

    def configure_optimizers(self) -> dict:
        """Returns the optimizer with a short linear warm-up, then the cosine to zero (App. A.5)."""
        config = self.optimizer_config

        # Norms and biases are vectors: pulling them to zero would only shrink what they scale.
        decayed = [p for p in self.network.parameters() if p.ndim > 1]
        others = [p for p in self.network.parameters() if p.ndim <= 1]
        spared = {"params": others, "weight_decay": 0.0}
        optimizer = config["rule"](
            [{"params": decayed}, spared], lr=config["lr"], weight_decay=config["weight_decay"]
        )
        total = int(self.trainer.estimated_stepping_batches)
        schedule = LambdaLR(optimizer, lambda step: rate_share(step, total, config["warmup"]))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def _require_finite(self, parts: Mapping[str, Tensor], batch: Mapping[str, Tensor]) -> None:
        if torch.isfinite(parts["total"]):
            return

        frames = ", ".join(f"{c}:{int(f)}" for c, f in zip(batch["clip"], batch["frame"]))
        values = ", ".join(f"{name}={value.item():g}" for name, value in parts.items())
        raise UserError(
            f"the loss is not finite ({values}) at epoch {self.current_epoch}, step "
            f"{self.global_step}, in the batch {frames}; checkpoints of earlier epochs are kept: "
            "look at these frames, or lower optimizer.lr"
        )


def rate_share(step: int, total: int, warmup: float) -> float:
    """Returns the share of the full learning rate at a step.

    The share rises in a line over ``warmup * total`` steps. Then it follows the cosine down to
    zero, which it reaches after the last step.
    """
    rising = warmup * total
    if step >= total:
        return 0.0
    if step < rising:
        return (step + 1) / (rising + 1)
    return 0.5 * (1 + math.cos(math.pi * (step - rising) / (total - rising)))
