"""Pretraining of the image encoder: what each pixel sees, and how far away that is."""

from collections.abc import Mapping

import torch
import torch.nn.functional as F
from jaxtyping import Float
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim import AdamW
from torchmetrics import MeanMetric
from torchmetrics.classification import MulticlassConfusionMatrix

from ..metrics.functional import iou_compute, mean_iou
from ..ontology import CLASSES, NUM_CLASSES
from .module import scheduled
from .neck import FPN

# Share of the steps over which the learning rate rises.
WARM_UP = 0.02


class ImagePretraining(LightningModule):
    """An image encoder under a pyramid and a 1x1 head, trained on `data.image_labels`.

    The loss is the cross-entropy of the pixels' classes plus the absolute error of the logarithm of
    their depth, where they see a voxel. Validation measures the IoU of the pixels' classes, the
    mean of those that are there or predicted, and the error of the logarithm. Only the backbone is
    kept: pyramid (``dim`` wide) and head stand for what will read it.
    """

    def __init__(self, backbone: nn.Module, dim: int, lr: float, weight_decay: float) -> None:
        super().__init__()
        self.backbone = backbone
        self.neck = FPN(backbone.channels, dim)
        self.head = nn.Conv2d(dim, NUM_CLASSES + 1, 1)
        self.to(memory_format=torch.channels_last)
        self.lr, self.weight_decay = lr, weight_decay
        self.count = MulticlassConfusionMatrix(NUM_CLASSES)
        self.depth_error, self.val_loss = MeanMetric(), MeanMetric()

    def forward(self, image: Tensor) -> tuple[Float[Tensor, "b 9 h w"], Float[Tensor, "b h w"]]:
        """Returns logits and the logarithm of the depth in metres, at the finest stride."""
        out = self.head(torch.relu(self.neck(self.backbone(image))[0]))
        return out[:, :NUM_CLASSES], out[:, NUM_CLASSES]

    def training_step(self, batch: Mapping[str, Tensor], index: int) -> Tensor:
        classes, depth, _ = self._losses(batch)
        self.log_dict({"train/classes": classes, "train/log_depth": depth})
        self.log("train/loss", classes + depth, prog_bar=True, logger=False)
        return classes + depth

    def validation_step(self, batch: Mapping[str, Tensor], index: int) -> None:
        classes, depth, logits = self._losses(batch)
        self.count.update(logits.argmax(dim=1), batch["classes"])
        self.depth_error.update(depth, weight=(batch["depth_m"] > 0).sum())
        self.val_loss.update(classes + depth)

    def on_validation_epoch_end(self) -> None:
        iou = iou_compute(self.count.compute()).float()
        self.log_dict({f"val/iou/{name}": value for name, value in zip(CLASSES, iou)})
        self.log("val/miou", mean_iou(iou))
        self.log("val/log_depth", self.depth_error.compute())
        self.log("val/loss", self.val_loss.compute())

        for metric in (self.count, self.depth_error, self.val_loss):
            metric.reset()

    def configure_optimizers(self) -> dict:
        """Returns AdamW with a short linear warm-up, then the cosine to zero."""
        optimizer = AdamW(self.parameters(), lr=self.lr, weight_decay=self.weight_decay)
        return scheduled(optimizer, self.trainer, WARM_UP)

    def _losses(self, batch: Mapping[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        logits, log_depth = self(batch["image"])
        classes = F.cross_entropy(logits, batch["classes"])

        # A depth of zero marks a pixel whose ray meets no voxel.
        sees = batch["depth_m"] > 0
        error = (log_depth - batch["depth_m"].clamp(min=0.1).log()).abs()
        depth = (error * sees).sum() / sees.sum().clamp(min=1)
        return classes, depth, logits
