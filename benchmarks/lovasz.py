"""What the exact Lovasz-Softmax costs, beside the loop in which it was published.

    python -m benchmarks.lovasz [--threads 1]

600,000 voxels x 9 classes, the paper's grid. Prints the median milliseconds of forward and
backward, their ratio, and how far loss and gradient are apart; asserts nothing. The reference is
the loop over classes of Berman et al. 2018 (Alg. 1 and Eq. 8): errors sorted as floats, running
Jaccard losses, their differences.
"""

import argparse
from collections.abc import Callable

import torch
import torch.nn.functional as F
from rich.console import Console
from rich.table import Table
from torch import Tensor

from benchmarks.timing import extra_mib, median_ms
from src.failures import told_in_one_line
from src.models.losses import lovasz_softmax, weighted_cross_entropy
from src.ontology import NUM_CLASSES, UNKNOWN
from src.provenance import machine

SHAPE = (100, 100, 60)
ROUNDS = 9
SHARES = (0.05, 0.12, 0.02, 0.003, 0.002, 0.004, 0.001, 0.005, 0.795)
"""About those of the classes in labels."""


def published_loop(logits: Tensor, target: Tensor) -> Tensor:
    """Class by class, with a descending sort of the errors."""
    probability = logits.softmax(dim=1).movedim(1, -1).reshape(-1, NUM_CLASSES)
    labels = target.flatten()
    known = labels != UNKNOWN
    probability, labels = probability[known], labels[known]
    losses = []
    for class_id in range(NUM_CLASSES):
        is_class = (labels == class_id).to(probability.dtype)
        if is_class.sum() == 0:
            continue
        errors, order = (is_class - probability[:, class_id]).abs().sort(descending=True)
        sorted_is_class = is_class[order]
        total = sorted_is_class.sum()
        intersection = total - sorted_is_class.cumsum(0)
        union = total + (1 - sorted_is_class).cumsum(0)
        jaccard = 1 - intersection / union
        jaccard[1:] = jaccard[1:] - jaccard[:-1]
        losses.append(errors @ jaccard)
    return torch.stack(losses).mean()


def scene() -> tuple[Tensor, Tensor]:
    """Labels in patches, a fifth of them unknown, and logits that get most of them right."""
    generator = torch.Generator().manual_seed(0)
    coarse = torch.multinomial(
        torch.tensor(SHARES), SHAPE[0] * SHAPE[1] * SHAPE[2] // 27 + 1, True, generator=generator
    )
    target = coarse.repeat_interleave(27)[: SHAPE[0] * SHAPE[1] * SHAPE[2]].view(1, *SHAPE)
    logits = torch.randn(1, NUM_CLASSES, *SHAPE, generator=generator)
    logits.scatter_add_(1, target[:, None], torch.full_like(logits[:, :1], 2.0))
    unknown = torch.rand(target.shape, generator=generator) < 0.2
    return logits.requires_grad_(), target.to(torch.uint8).masked_fill(unknown, UNKNOWN)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    torch.set_num_threads(parser.parse_args().threads)
    logits, target = scene()

    def with_backward(loss: Callable[..., Tensor]) -> Callable[[], Tensor]:
        return lambda: torch.autograd.grad(loss(logits, target), logits)[0]

    def framework_cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
        return F.cross_entropy(logits, target.long(), ignore_index=UNKNOWN)

    todo = {
        "Lovasz-Softmax, the published loop": with_backward(published_loop),
        "Lovasz-Softmax, ours": with_backward(lovasz_softmax),
        "cross-entropy, the framework's": with_backward(framework_cross_entropy),
        "weighted cross-entropy, ours": with_backward(
            lambda logits, target: weighted_cross_entropy(logits, target, torch.ones(NUM_CLASSES))
        ),
    }
    spent_ms = median_ms(todo, ROUNDS)
    table = Table(title=f"{machine()}, {torch.get_num_threads()} thread(s); forward and backward")
    for column in ("loss of 600,000 voxels x 9", "ms", "times faster", "MiB more"):
        table.add_column(column, justify="left" if column.startswith("loss") else "right")
    for name, spent in spent_ms.items():
        ratio = f"{spent_ms['Lovasz-Softmax, the published loop'] / spent:.1f}"
        memory = f"{extra_mib(todo[name]):.0f}"
        table.add_row(name, f"{spent:.0f}", ratio if "Lovasz" in name else "", memory)
    console = Console(width=100)
    console.print(table)
    exact = published_loop(logits.double(), target)
    ours, published = (
        torch.autograd.grad(f(logits, target), logits)[0] for f in (lovasz_softmax, published_loop)
    )
    gap = abs(lovasz_softmax(logits, target) - published_loop(logits, target)).item()
    relative = ((ours - published).norm() / published.norm()).item()
    console.print(f"losses differ by {gap:.1e}, gradients by {relative:.1e} (relative)")
    off = [abs(loss(logits, target) - exact).item() for loss in (lovasz_softmax, published_loop)]
    console.print(
        f"from the loop in float64, ours is off by {off[0]:.1e}, the loop by {off[1]:.1e}"
    )


if __name__ == "__main__":
    with told_in_one_line():
        main()
