"""What is seen of a training while it runs: the lines of its epochs, and its first predictions."""

import re

import lightning
import pytest
import torch
from PIL import Image
from torch import nn
from torch.utils.data import DataLoader

from src import terminal
from src.atomic import replacing
from src.tasks.fit import fit
from src.tasks.watching import Preview, Progress
from tests.synthetic import compose_config


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

    def test_step(self, loss, index):
        pass

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)


def test_a_log_says_how_far_the_whole_training_is_and_an_epoch_s_mean_loss(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(terminal, "LINE_S", 0.01)
    seen = []

    class Waits(lightning.Callback):
        def on_train_batch_end(self, trainer, *_):
            seen.append(progress._meter.done / progress._meter.total)
            torch.multiprocessing.Event().wait(0.05)

    progress = Progress()
    trainer = lightning.Trainer(
        **{"max_epochs": 2, "accumulate_grad_batches": 2, "num_sanity_val_steps": 1},
        **{"accelerator": "cpu", "logger": False, "default_root_dir": tmp_path},
        **{"enable_progress_bar": False, "enable_checkpointing": False},
        callbacks=[progress, Waits()],
    )
    trainer.fit(LogsLosses(), DataLoader([9.0, 1.0, 2.0]), DataLoader([0.5]))

    # Two epochs of three steps, each with one of validation, which counts as 0.3.
    assert seen == pytest.approx([n / 6.6 for n in (1, 2, 3, 4.3, 5.3, 6.3)])
    output = capsys.readouterr().out
    assert re.search(r"training, epoch 2/2: \d+ % after \d+ s", output)
    lines = re.findall(
        r"epoch (\d/2): train loss (\S+), val loss (\S+), val KAR-mIoU (\S+) %", output
    )
    assert lines == [("1/2", "4.000", "0.500", "5.0"), ("2/2", "4.000", "0.500", "5.0")]


@pytest.mark.slow
def test_its_first_predictions_are_drawn_once_and_change_nothing(trained, tmp_path, capsys):
    """The training with the picture has the very numbers of the one without."""
    words = [word for word in trained if not word.startswith(("paths.runs", "trainer.max_epochs"))]
    words += ["trainer.max_epochs=2"]
    drawn = compose_config(*words, f"paths.runs={tmp_path}/drawn")
    plain = compose_config(*words, f"paths.runs={tmp_path}/plain", "~callbacks.preview")
    for cfg in (drawn, plain):
        fit(cfg)

    folders = [tmp_path / name / "tiny/skyocc/seed0" for name in ("drawn", "plain")]
    log, other = ((folder / "metrics.csv").read_bytes() for folder in folders)
    assert log == other
    picture, nothing = (folder / "figures/first_epoch.png" for folder in folders)
    assert Image.open(picture).width > 1000
    assert not nothing.exists()
    assert capsys.readouterr().out.count("first_epoch.png") == 1


def test_the_last_epoch_has_no_time_left_and_scoring_says_that_it_begins(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(terminal.Meter, "left_s", 60.0)
    progress = Progress()
    trainer = lightning.Trainer(
        **{"max_epochs": 2, "num_sanity_val_steps": 0, "accelerator": "cpu", "logger": False},
        **{"enable_progress_bar": False, "enable_checkpointing": False},
        **{"enable_model_summary": False, "default_root_dir": tmp_path, "callbacks": [progress]},
    )
    module = LogsLosses()
    trainer.fit(module, DataLoader([9.0, 1.0]), DataLoader([0.5]))
    trainer.test(module, DataLoader([0.5]), verbose=False)
    first, last, scoring = re.findall(
        r"^(?:epoch|scoring).*$", capsys.readouterr().out, re.MULTILINE
    )
    assert re.search(r"epoch 1/2: .* left of the training$", first)
    assert re.search(r"epoch 2/2: .* val KAR-mIoU 5\.0 %$", last)
    assert scoring == "scoring the test split"


class AfterAnEpoch:
    current_epoch, is_global_zero, sanity_checking, datamodule = 0, True, False, None


@pytest.mark.parametrize("what", [{"is_global_zero": False}, {"sanity_checking": True}])
def test_only_the_first_process_draws_and_no_untrained_network(what, tmp_path):
    other = type("Other", (AfterAnEpoch,), what)()
    Preview(tmp_path / "first.png", frames=1).on_validation_end(other, None)
    assert not any(tmp_path.iterdir())


def test_a_picture_that_finds_no_room_does_not_end_the_training(tmp_path, monkeypatch, capsys):
    def drawn(module, data, part, path, *_):
        with replacing(path) as temporary:
            temporary.touch()

    monkeypatch.setattr("src.tasks.scenes.draw_sheet", drawn)
    (tmp_path / "file").touch()
    Preview(tmp_path / "file/first.png", frames=1).on_validation_end(AfterAnEpoch(), None)
    assert "no picture of the first predictions: " in capsys.readouterr().out
    Preview(tmp_path / "first.png", frames=1).on_validation_end(AfterAnEpoch(), None)
    assert (tmp_path / "first.png").is_file()
