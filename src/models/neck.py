"""Feature pyramid: the four levels of the image encoder, brought to one width."""

from collections.abc import Sequence

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn


class FPN(nn.Module):
    """Lateral 1x1, top-down nearest upsampling, 3x3 output (Lin et al. 2017).

    ``in_channels`` are those of the levels, finest first; every output has ``dim`` channels.
    """

    def __init__(self, in_channels: Sequence[int], dim: int) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(nn.Conv2d(channels, dim, 1) for channels in in_channels)
        self.output = nn.ModuleList(nn.Conv2d(dim, dim, 3, padding=1) for _ in in_channels)

    def forward(
        self, features: Sequence[Float[Tensor, "b _ _ _"]]
    ) -> list[Float[Tensor, "b dim _ _"]]:
        levels = [lateral(feature) for lateral, feature in zip(self.lateral, features)]
        for fine in range(len(levels) - 2, -1, -1):
            size = levels[fine].shape[-2:]
            levels[fine] = levels[fine] + F.interpolate(levels[fine + 1], size, mode="nearest")
        return [output(level) for output, level in zip(self.output, levels)]
