"""The lines of a training without a terminal."""

import re

import lightning
import torch
from torch import nn
from torch.utils.data import DataLoader

from src.tasks.trainer import EpochLines


class LogsLosses(lightning.LightningModule):
    """Logs the losses that it is given, and learns nothing."""

    def __init__(self):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(1))

    def training_step(self, loss, index):
        self.log("train/loss", loss.mean(), prog_bar=True, logger=False)
        return 0 * self.weight.sum()

    def validation_step(self, loss, index):
        self.log_dict({"val/loss": loss.mean(), "val/kar_miou": loss.mean() / 10})

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)


def test_the_loss_of_a_line_is_the_mean_of_its_epoch(tmp_path, capsys):
    trainer = lightning.Trainer(
        max_epochs=2,
        accumulate_grad_batches=2,
        num_sanity_val_steps=0,
        accelerator="cpu",
        callbacks=[EpochLines()],
        logger=False,
        enable_progress_bar=False,
        enable_checkpointing=False,
        default_root_dir=tmp_path,
    )
    trainer.fit(LogsLosses(), DataLoader([9.0, 1.0, 2.0]), DataLoader([0.5]))
    lines = re.findall(
        r"epoch (\d/2): train loss (\S+), val loss (\S+), val KAR-mIoU (\S+) %",
        capsys.readouterr().out,
    )

    assert lines == [("1/2", "4.000", "0.500", "5.0"), ("2/2", "4.000", "0.500", "5.0")]
