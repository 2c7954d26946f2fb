"""Run by test_processes: writes the gradients of a first optimiser step, with as many processes as
asked for: ``python -m tests.gradients_of_one_step FILE [overrides]``."""

import sys

import torch
from lightning.pytorch.callbacks import Callback

from src.failures import quiet_libraries
from src.tasks.dataset import root_of
from src.tasks.session import data_of
from src.tasks.trainer import trainer_of
from tests.synthetic import compose_config, untrained


class WriteGradients(Callback):
    def __init__(self, path):
        self.path = path

    def on_before_optimizer_step(self, trainer, module, optimizer):
        gradients = {name: p.grad for name, p in module.named_parameters()}
        torch.save(gradients, f"{self.path}.{trainer.global_rank}")


def main(path, *overrides):
    cfg = compose_config(*overrides)
    data = data_of(cfg, root_of(cfg))
    module, trainer = untrained(cfg, data), trainer_of(cfg)
    trainer.callbacks = [WriteGradients(path)]
    trainer.fit(module, datamodule=data)


if __name__ == "__main__":
    quiet_libraries()
    torch.use_deterministic_algorithms(True)
    main(*sys.argv[1:])
