"""The LightningModule: steps, schedule, and what happens when the loss is not finite."""

from pathlib import Path
from unittest.mock import Mock

import lightning
import pytest
import torch
from torch import nn
from torch.utils.data import DataLoader

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import OccupancyScores
from src.models.checkpoint import load_weights, read_content
from src.models.module import OccupancyModule, rate_share
from src.models.network import Step

OPTIMIZER = {"rule": torch.optim.AdamW, "lr": 0.1, "weight_decay": 0.01, "warmup": 0.25}


class Shift(nn.Module):
    """The smallest network: one number, added to every logit of class 1."""

    def __init__(self):
        super().__init__()
        self.shift = nn.Parameter(torch.zeros(1))
        self.matrix = nn.Parameter(torch.ones(1, 1))

    def history_of(self, batch):
        return None

    def step(self, batch, history):
        return Step(self(batch), None, None)

    def forward(self, batch):
        shape = (len(batch["frame"]), 1, *batch["semantics"].shape[1:])
        return torch.cat([torch.zeros(shape), self.matrix * self.shift.expand(shape)], dim=1)


class MeanLogit(nn.Module):
    """A loss that turns NaN at the calls asked for."""

    def __init__(self, broken_calls=()):
        super().__init__()
        self.calls, self.broken_calls = 0, broken_calls

    def forward(self, logits, target):
        total = (1 - logits[:, 1]).square().mean()
        if self.calls in self.broken_calls:
            total = total * torch.nan
        self.calls += 1
        return {"cross_entropy": total, "total": total}


def make_scores():
    return OccupancyScores(VoxelGrid((0, 0, 0), (2, 2, 2), (2, 2, 2)), num_classes=2, free_index=1)


def samples(count):
    return [
        {
            "semantics": torch.full((2, 2, 2), int(index < 2), dtype=torch.uint8),
            "velocity_mps": torch.ones(3),
            "clip": "town/held" if index < 2 else "town/seen",
            "frame": index,
        }
        for index in range(count)
    ]


def build(broken_calls=()):
    return OccupancyModule(Shift(), MeanLogit(broken_calls), make_scores, OPTIMIZER, nn.Identity())


def train(module, folder, epochs=3, *callbacks):
    checkpoint = lightning.pytorch.callbacks.ModelCheckpoint(
        folder, "best", "val/kar_miou", mode="max", save_last=True
    )
    lightning.Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        logger=False,
        callbacks=[checkpoint, *callbacks],
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        log_every_n_steps=1,
    ).fit(module, *(DataLoader(samples(count), batch_size=2) for count in (8, 4)))


def test_the_loss_falls_while_the_rate_rises_over_the_warm_up_and_ends_at_zero(tmp_path):
    rates, module = [], build()

    class Recorder(lightning.Callback):
        def on_train_batch_start(self, trainer, module, batch, index):
            rates.append(trainer.optimizers[0].param_groups[0]["lr"])

    train(module, tmp_path, 5, Recorder())
    assert module.network.shift.item() > 0.2
    # A quarter of the 20 steps on a line up, then half a cosine.
    assert rates[:6] == pytest.approx([0.1 / 6 * n for n in range(1, 6)] + [0.1])
    assert rates[5:] == sorted(rates[5:], reverse=True)
    assert rates[12] + rates[13] == pytest.approx(0.1)
    assert 0 < rates[-1] < 0.002


def test_weight_decay_spares_biases_and_norms():
    module = build()
    module._trainer = Mock(spec=lightning.Trainer, estimated_stepping_batches=4)
    decayed, spared = module.configure_optimizers()["optimizer"].param_groups
    assert [p.ndim for p in decayed["params"]] == [2]
    assert decayed["weight_decay"] == OPTIMIZER["weight_decay"]
    assert [p.ndim for p in spared["params"]] == [1]
    assert spared["weight_decay"] == 0


@pytest.mark.parametrize("warmup", [0.0, 0.05, 0.25, 0.96, 1.0])
def test_the_schedule_holds_for_every_length(warmup):
    for total in range(1, 41):
        shares = [rate_share(step, total, warmup) for step in range(total + 1)]
        assert all(0 < share <= 1 for share in shares[:-1])
        assert shares[-1] == 0


@pytest.mark.parametrize(
    ("broken_call", "where"),
    # An epoch is four calls in training and two in validation.
    [
        (9, "epoch 1, step 7, in the batch town/seen:6, town/seen:7;"),
        (10, "epoch 1, step 8, in the batch town/held:0, town/held:1;"),
        (0, "epoch 0, step 0, "),
    ],
)
def test_a_loss_that_is_not_finite_stops_and_names_the_batch(tmp_path, broken_call, where):
    module = build(broken_calls=(broken_call,))
    with pytest.raises(UserError, match=rf"^.*total=nan.*{where}.*$"):
        train(module, tmp_path)
    assert module.network.shift.isfinite().all()
    epochs = [read_content(path)["epoch"] for path in tmp_path.glob("last.ckpt")]
    assert epochs == ([] if broken_call == 0 else [0]), "what came before is kept"


@pytest.mark.parametrize("other", [nn.Linear(4, 3), nn.Linear(2, 3, bias=False)])
def test_weights_of_another_shape_or_name_are_refused(other):
    with pytest.raises(UserError, match=r"^ckpt_path: last\.ckpt .*\(1 parameters differ"):
        load_weights(nn.Linear(2, 3), other.state_dict(), Path("last.ckpt"))
