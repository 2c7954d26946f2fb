"""Feature pyramid: the four levels of the image encoder, brought to one width."""

from collections.abc import Collection, Sequence

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from .backbone import STRIDES
from .tensors import Features


class FPN(nn.Module):
    """A feature pyramid: lateral 1x1, top-down nearest upsampling, 3x3 output (Lin et al. 2017).

    ``in_channels`` are those of the levels, finest first; every output has ``dim`` channels.
    Only the levels at ``strides`` are given, and only what leads to them is computed.
    """

    def __init__(
        self, in_channels: Sequence[int], dim: int, strides: Collection[int] = STRIDES
    ) -> None:
        super().__init__()
        read = [stride in strides for stride in STRIDES]
        self.finest = read.index(True)

        # What is left out keeps its place, so that names do not depend on the strides.
        self.lateral = nn.ModuleList(
            nn.Conv2d(channels, dim, 1) if level >= self.finest else None
            for level, channels in enumerate(in_channels)
        )
        self.output = nn.ModuleList(
            nn.Conv2d(dim, dim, 3, padding=1) if wanted else None for wanted in read
        )

    def forward(self, features: Sequence[Float[Tensor, "b _ _ _"]]) -> Features:
        """Returns the levels, finest first; ``None`` in the place of one that is left out."""
        levels = [
            lateral(feature) if lateral is not None else None
            for lateral, feature in zip(self.lateral, features)
        ]

        for fine in range(len(levels) - 2, self.finest - 1, -1):
            size = levels[fine].shape[-2:]
            levels[fine] = levels[fine] + F.interpolate(levels[fine + 1], size, mode="nearest")

        return [
            output(level) if output is not None else None
            for output, level in zip(self.output, levels)
        ]
