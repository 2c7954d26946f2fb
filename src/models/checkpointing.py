"""Stages computed twice for the sake of memory, and batch normalisation that stays as it is."""

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any

import torch
from torch import nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.utils.checkpoint import checkpoint


@contextmanager
def running_statistics(module: nn.Module) -> Iterator[None]:
    """Lets batch normalisation inside use its running statistics, and leaves them as they are."""
    norms = [m for m in module.modules() if isinstance(m, _BatchNorm) and m.training]
    # Copies: a backward through here reads them after the next batch has changed the originals.
    with _in_state(norms, [{**_state(norm), "training": False} for norm in norms]):
        yield


def recompute_in_backward(network: nn.Module) -> None:
    """Lets every module that calls itself ``recomputable`` keep only its inputs in training.

    What it computed it computes again in the backward, one module at a time; the names of the
    parameters stay.
    """
    for module in network.modules():
        if getattr(module, "recomputable", False):
            module.forward = functools.partial(_forward, module, module.forward)


def _forward(module: nn.Module, forward: Callable[..., Any], *inputs: Any) -> Any:
    """Calls ``forward`` so that its backward may call it again, to the same numbers.

    The second time, batch normalisation does as it did the first time, and counts nothing.
    """
    if not (module.training and torch.is_grad_enabled()):
        return forward(*inputs)
    norms = [m for m in module.modules() if isinstance(m, _BatchNorm)]
    states = [_state(norm) for norm in norms]

    def contexts() -> tuple[AbstractContextManager, AbstractContextManager]:
        return nullcontext(), _in_state(norms, states)

    return checkpoint(forward, *inputs, use_reentrant=False, context_fn=contexts)


def _state(norm: _BatchNorm) -> dict[str, Any]:
    """Copies the mode and the running statistics of a norm, which later batches change."""
    buffers = {name: buffer.clone() for name, buffer in norm.named_buffers()}
    return {"training": norm.training, **buffers}


@contextmanager
def _in_state(norms: Sequence[_BatchNorm], states: Sequence[dict[str, Any]]) -> Iterator[None]:
    """Gives every norm another state, and in the end the one that it had before."""
    with ExitStack() as before:
        for norm, state in zip(norms, states):
            for name, value in state.items():
                before.callback(setattr, norm, name, getattr(norm, name))
                setattr(norm, name, value)
        yield
