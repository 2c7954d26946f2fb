"""What a training says in a log file, where a progress bar would only leave rubbish."""

import time

import lightning
from lightning.pytorch.callbacks import Callback


class EpochLines(Callback):
    """Prints one line after every validation: the losses, the score, and the time that is left.

    The loss of the training is the mean over the epoch's batches.
    """

    score, called = "val/kar_miou", "KAR-mIoU"

    def on_train_start(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        self._start_s, self._first_epoch = time.perf_counter(), trainer.current_epoch

    def on_train_epoch_start(
        self, trainer: lightning.Trainer, module: lightning.LightningModule
    ) -> None:
        self._losses, self._batches = 0.0, 0

    def on_train_batch_end(
        self, trainer: lightning.Trainer, module: lightning.LightningModule, *batch: object
    ) -> None:
        # Summed where it is: to read it would wait for the device.
        self._losses = self._losses + trainer.callback_metrics["train/loss"]
        self._batches += 1

    def on_validation_end(
        self, trainer: lightning.Trainer, module: lightning.LightningModule
    ) -> None:
        if not trainer.is_global_zero:
            return
        done = trainer.current_epoch + 1
        spent_s = time.perf_counter() - self._start_s
        left_s = spent_s / (done - self._first_epoch) * (trainer.max_epochs - done)
        scores = trainer.callback_metrics
        print(
            f"epoch {done}/{trainer.max_epochs}: "
            f"train loss {self._losses / self._batches:.3f}, val loss {scores['val/loss']:.3f}, "
            f"val {self.called} {100 * scores[self.score]:.1f} %, {left_s / 60:.1f} min left",
            flush=True,
        )


class PretrainingLines(EpochLines):
    """The same of what pixels see."""

    score, called = "val/miou", "pixel mIoU"
