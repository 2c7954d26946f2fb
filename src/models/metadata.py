"""What the UAV measures of itself, as a vector that is added to every pillar."""

import math
from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError

# Typical sizes, by which the measurements are divided.
ATTITUDE_SCALE_RAD = 0.3
SPEED_SCALE_MPS = 10.0
# A height is given by its phase in waves from two voxels of the paper's grid to its whole flight
# envelope. At which voxel of a pillar the ground lies is then nearly a linear function of them.
HEIGHT_WAVES_M = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# Numbers of each measurement.
WIDTHS = {"attitude": 2, "velocity": 3, "height": 2 * len(HEIGHT_WAVES_M)}


class Metadata(nn.Module):
    """Turns auxiliary measurements of the current frame into a vector.

    ``names`` are some of `WIDTHS`: ``attitude`` is roll and pitch; ``velocity`` is in the occ
    frame; ``height`` is the UAV's above the world's ground plane, as of a barometer that was set to
    zero at take-off. The paper has a "UAV state" beside the image and does not say what is in it.

    Raises `UserError` for other names.
    """

    def __init__(self, dim: int, names: Sequence[str]) -> None:
        super().__init__()
        if isinstance(names, (str, bool)) or not {*names} <= {*WIDTHS}:
            raise UserError(f"model.metadata: {names}; give a list of {', '.join(WIDTHS)}, or []")
        self.names = [name for name in WIDTHS if name in names]
        width = sum(WIDTHS[name] for name in self.names)
        # Normalised, so that it is as large as the pillars from the first step on.
        self.layers = nn.Sequential(
            nn.Linear(width, dim), nn.ReLU(), nn.Linear(dim, dim), nn.LayerNorm(dim)
        )

    def forward(self, batch: Mapping[str, Tensor]) -> Float[Tensor, "b dim"]:
        measured = {
            "attitude": batch["attitude_rad"] / ATTITUDE_SCALE_RAD,
            "velocity": batch["velocity_mps"] / SPEED_SCALE_MPS,
            "height": height_phases(batch["height_m"]),
        }
        return self.layers(torch.cat([measured[name].float() for name in self.names], dim=-1))


def height_phases(height_m: Float[Tensor, "b"]) -> Float[Tensor, "b phases"]:
    """Returns sine and cosine of a height in each of `HEIGHT_WAVES_M`."""
    phase = 2 * math.pi * height_m[:, None] / height_m.new_tensor(HEIGHT_WAVES_M)
    return torch.cat([phase.sin(), phase.cos()], dim=-1)
