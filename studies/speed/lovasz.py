"""The cost of the exact Lovász-Softmax, beside the loop in which it was published.

    python -m studies.speed.lovasz [--threads 1]

600,000 voxels x 9 classes, the paper's grid. Prints the median milliseconds of forward and
backward, their ratio, and how far loss and gradient are apart; asserts nothing. The reference is
the loop over classes of Berman et al. 2018 (Alg. 1 and Eq. 8): errors sorted as floats, running
Jaccard losses, their differences.
"""

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from src.models.losses import cross_entropy, lovasz, supervised
from src.ontology import NUM_CLASSES, UNKNOWN
from studies.settings import run
from studies.speed.timing import print_costs

SHAPE = (100, 100, 60)
ROUNDS = 9
# About the shares of the classes in labels.
SHARES = (0.05, 0.12, 0.02, 0.003, 0.002, 0.004, 0.001, 0.005, 0.795)


def published_loop(logits: Tensor, target: Tensor) -> Tensor:
    """Computes the loss class by class, with a descending sort of the errors."""
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
    """Returns labels in patches, a fifth of them unknown, and logits that get most right."""
    generator, voxels = torch.Generator().manual_seed(0), math.prod(SHAPE)
    shares = torch.tensor(SHARES)
    coarse = torch.multinomial(shares, voxels // 27 + 1, replacement=True, generator=generator)
    target = coarse.repeat_interleave(27)[:voxels].view(1, *SHAPE)

    logits = torch.randn(1, NUM_CLASSES, *SHAPE, generator=generator)
    logits.scatter_add_(1, target[:, None], torch.full_like(logits[:, :1], 2.0))
    unknown = torch.rand(target.shape, generator=generator) < 0.2
    return logits.requires_grad_(), target.to(torch.uint8).masked_fill(unknown, UNKNOWN)


def lovasz_softmax(logits: Tensor, target: Tensor) -> Tensor:
    return lovasz(*supervised(logits, target))


def framework_cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
    return F.cross_entropy(logits, target.long(), ignore_index=UNKNOWN)


def weighted(logits: Tensor, target: Tensor) -> Tensor:
    return cross_entropy(*supervised(logits, target), torch.ones(NUM_CLASSES))


def main(*, threads: int = 1) -> None:
    torch.set_num_threads(threads)
    logits, target = scene()

    def with_backward(loss: Callable[..., Tensor]) -> Callable[[], Tensor]:
        return lambda: torch.autograd.grad(loss(logits, target), logits)[0]

    losses = {
        "Lovász-Softmax, the published loop": published_loop,
        "Lovász-Softmax, ours": lovasz_softmax,
        "cross-entropy, the framework's": framework_cross_entropy,
        "weighted cross-entropy, ours": weighted,
    }
    measures = {name: with_backward(loss) for name, loss in losses.items()}
    subject = "a loss of 600,000 voxels x 9, forward and backward"
    print_costs(subject, measures, ROUNDS, compared(logits, target))


def compared(logits: Tensor, target: Tensor) -> tuple[str, str]:
    """Prints the differences of both losses and their gradients, and from float64."""
    pair = (lovasz_softmax, published_loop)
    # The loop subtracts running sums in float32, which costs it digits.
    losses = torch.stack([loss(logits, target) for loss in pair])
    ours, published = (torch.autograd.grad(loss, logits, retain_graph=True)[0] for loss in losses)
    relative = ((ours - published).norm() / published.norm()).item()
    gap = abs(losses[0] - losses[1]).item()
    exact = published_loop(logits.double(), target)
    off = (losses.double() - exact).abs().tolist()
    return (
        f"losses differ by {gap:.1e}, gradients by {relative:.1e} (relative)",
        f"from the loop in float64, ours is off by {off[0]:.1e}, the loop by {off[1]:.1e}",
    )


if __name__ == "__main__":
    run(main)
