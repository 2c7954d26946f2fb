"""What somebody sees of a training while it runs: how far it is, and its first predictions."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback

from ..errors import UserError
from ..terminal import Meter, duration, metered, say

# What a step of the validation costs, measured in steps of the training: it has no backward pass.
VALIDATION = 0.3


class Progress(Callback):
    """Shows how much of a training or of its test is done, and prints a line after every epoch.

    The line has the losses, the score on validation and the time that is left. The loss of the
    training is the mean over the epoch's batches. Only the first process prints.
    """

    def __init__(self) -> None:
        self._shown = ExitStack()
        self._meter: Meter | None = None

    def on_train_start(self, trainer: Trainer, module: LightningModule) -> None:
        epochs = trainer.max_epochs - trainer.current_epoch
        steps = trainer.num_training_batches + VALIDATION * sum(trainer.num_val_batches)
        self._show(trainer, "training", epochs * steps)

    def on_train_epoch_start(self, trainer: Trainer, module: LightningModule) -> None:
        self._losses, self._batches = 0.0, 0
        self._meter.doing = f"training, epoch {trainer.current_epoch + 1}/{trainer.max_epochs}"

    def on_train_batch_end(self, trainer: Trainer, module: LightningModule, *batch: Any) -> None:
        # Summed on the device: to read it here would wait for the device.
        self._losses = self._losses + trainer.callback_metrics["train/loss"]
        self._batches += 1
        self._meter.advance()

    def on_validation_batch_end(self, trainer: Trainer, *batch: Any) -> None:
        if not trainer.sanity_checking:
            self._meter.advance(VALIDATION)

    def on_validation_end(self, trainer: Trainer, module: LightningModule) -> None:
        if not trainer.is_global_zero or trainer.sanity_checking:
            return
        scores, left_s = trainer.callback_metrics, self._meter.left_s
        is_last = trainer.current_epoch + 1 == trainer.max_epochs
        left = "" if is_last or left_s is None else f", {duration(left_s)} left of the training"
        say(
            f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}: "
            f"train loss {self._losses / self._batches:.3f}, val loss {scores['val/loss']:.3f}, "
            f"val KAR-mIoU {100 * scores['val/kar_miou']:.1f} %{left}"
        )

    def on_test_start(self, trainer: Trainer, module: LightningModule) -> None:
        if trainer.is_global_zero:
            say("scoring the test split")
        self._show(trainer, "scoring the test split", sum(trainer.num_test_batches))

    def on_test_batch_end(self, trainer: Trainer, *batch: Any) -> None:
        self._meter.advance()

    def on_train_end(self, *_: Any) -> None:
        self._shown.close()

    on_test_end = on_exception = on_train_end

    def _show(self, trainer: Trainer, doing: str, total: float) -> None:
        if trainer.is_global_zero:
            self._meter = self._shown.enter_context(metered(doing, total))
        else:
            self._meter = Meter(doing, total)


class Preview(Callback):
    """Draws what the model predicts on a few frames of validation, once its first epoch is over.

    Whoever waits for a training sees from it whether anything is learned.
    """

    def __init__(self, path: str | Path, frames: int) -> None:
        self.path, self.frames = Path(path), frames

    def on_validation_end(self, trainer: Trainer, module: LightningModule) -> None:
        is_first = not (trainer.current_epoch or trainer.sanity_checking)
        if not (is_first and trainer.is_global_zero):
            return
        # Training needs no drawing code; it is loaded for the picture alone.
        from .scenes import draw_sheet

        heading = "Validation, after the first epoch"
        try:
            draw_sheet(module, trainer.datamodule, "val", self.path, heading, self.frames)
        except UserError as error:  # a picture is no reason to end a training
            say(f"no picture of the first predictions: {error}")
        else:
            say(f"{self.path}: the first predictions, beside the labels")
