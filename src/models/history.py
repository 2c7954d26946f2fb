"""Pillars of past frames: aligned to the current frame (ego-motion), and attended to (Eq. 7)."""

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import VoxelGrid, inverse
from .sampling import summed_samples

DZ_SCALE_M = 5.0
"""Vertical shifts between frames are divided by this before they are embedded."""


class History(NamedTuple):
    """Pillars of the n frames before the current one, oldest first, the last one step old.

    ``pillars`` [B, n, P, D] as `SkyOcc.carried` gave them, ``occ_from_past_occ`` [B, n, 4, 4]
    (current occ <- past occ), ``valid`` [B, n]: where it is False, the frame does not exist and
    whatever stands in its place is never read.
    """

    pillars: Float[Tensor, "b n p dim"]
    occ_from_past_occ: Float[Tensor, "b n 4 4"]
    valid: Bool[Tensor, "b n"]

    @classmethod
    def of(cls, steps: Sequence[Tensor], batch: Mapping[str, Tensor]) -> "History":
        """Joins what each of the n frames before a batch's current ones left behind."""
        before = slice(-1 - len(steps), -1)
        motion, valid = batch["occ_from_past_occ"][:, before], batch["history_valid"][:, before]
        return cls(torch.stack(list(steps), dim=1), motion, valid)


class PillarMemory:
    """Keeps the pillars of the last ``length`` steps, whose batches were consecutive frames.

    Each place of the batch is a stream of its own (`data.batches.StreamBatches`). The batch's
    ``history_valid`` says how far back it goes. The weights change between the steps, so older
    pillars are those of older weights: the price of not computing them again.
    """

    def __init__(self, length: int) -> None:
        self.steps: deque[Tensor] = deque(maxlen=length)

    def clear(self) -> None:
        """Forgets everything: at the start of an epoch."""
        self.steps.clear()

    def keep(self, pillars: Float[Tensor, "b p dim"]) -> None:
        """Keeps what a step left behind, without its graph."""
        self.steps.append(pillars.detach())

    def history(self, batch: Mapping[str, Tensor]) -> History | None:
        """Returns the history of a batch's current frames; ``None`` where nothing is kept.

        Raises `RuntimeError` where the batch relies on steps that were never taken.
        """
        kept = len(self.steps)
        older = batch["history_valid"][:, : -1 - kept]
        if kept < self.steps.maxlen and older.any():
            raise RuntimeError("a batch of a stream refers to steps that were never taken")
        return History.of(self.steps, batch) if kept else None


class AlignedHistory(NamedTuple):
    """Past pillars at the current pillars' places; zero where ``valid`` [B, n, P] is False.

    ``dz_m`` [B, n] is how much higher than the current frame the UAV was in the past one.
    """

    pillars: Float[Tensor, "b n p dim"]
    valid: Bool[Tensor, "b n p"]
    dz_m: Float[Tensor, "b n"]


def align_history(history: History, grid: VoxelGrid) -> AlignedHistory:
    """Resample past pillars bilinearly at the current pillars' centers.

    The occ frames are gravity-stabilised, so they differ by a yaw and a translation; the part of it
    in the plane moves pillars, the rest is ``dz_m``. A pillar whose center falls outside the past
    grid is not valid for that frame.
    """
    rows, columns, _ = grid.shape
    eye = torch.eye(4, device=history.valid.device)
    occ_from_past_occ = history.occ_from_past_occ.float()
    occ_from_past_occ = torch.where(history.valid[..., None, None], occ_from_past_occ, eye)

    pillars = history.pillars.float()
    lower = eye.new_tensor(grid.lower_m[:2])
    cells = eye.new_tensor((rows, columns))
    index = torch.cartesian_prod(*(torch.arange(n, device=eye.device) for n in (rows, columns)))
    centers = lower + (index + 0.5) * grid.voxel_m

    with torch.autocast(eye.device.type, enabled=False):
        past_from_now = inverse(occ_from_past_occ)[..., :2, :]
        turned = centers @ past_from_now[..., :2].transpose(-1, -2)
    place = (turned + past_from_now[..., None, :, 3] - lower) / grid.voxel_m
    valid = ((place >= 0) & (place <= cells)).all(dim=-1) & history.valid[..., None]

    # Beyond the outermost centers there is nothing to interpolate with.
    place = (place - 0.5).clamp(min=torch.zeros_like(cells), max=cells - 1)
    row, column = place.flatten(0, 2).T[:, None, None, None]

    maps = pillars.flatten(0, 1).unflatten(1, (rows, columns))
    frame = torch.arange(len(maps), device=eye.device).repeat_interleave(len(centers))
    aligned = summed_samples([maps], column, row, torch.ones_like(row), frame).view_as(pillars)
    return AlignedHistory(
        torch.where(valid[..., None], aligned, 0), valid, occ_from_past_occ[..., 2, 3]
    )


class TemporalAttention(nn.Module):
    """The paper's TAttn (Eq. 7): a pillar attends to itself and to its own aligned past.

    Each past frame carries embeddings of its age in steps and of its vertical shift. The pillar
    itself is always valid, so without history this is a projection of the pillar alone.
    ``num_frames`` is the paper's L, the current frame included.
    """

    recomputable = True

    def __init__(self, dim: int, num_heads: int, num_frames: int) -> None:
        super().__init__()
        if dim % num_heads:
            raise UserError(f"size.heads: {num_heads} does not divide size.dim, {dim}")
        self.num_heads = num_heads
        self.age = nn.Parameter(0.02 * torch.randn(num_frames, dim))
        self.dz = (
            nn.Sequential(nn.Linear(1, dim), nn.ReLU(), nn.Linear(dim, dim))
            if num_frames > 1
            else None
        )
        self.query = nn.Linear(dim, dim)
        self.key_value = nn.Linear(dim, 2 * dim)
        self.output = nn.Linear(dim, dim)

    def forward(
        self, pillars: Float[Tensor, "#b p dim"], history: AlignedHistory | None
    ) -> Float[Tensor, "b p dim"]:
        tokens = (pillars + self.age[0])[:, None]
        if history is not None:
            past = history.pillars + self._frame_embedding(history.dz_m)[:, :, None]
            tokens = torch.cat([past, tokens.expand(len(past), -1, -1, -1)], dim=1)

        key, value = self.key_value(tokens).unflatten(-1, (2, self.num_heads, -1)).unbind(-3)
        query = self.query(pillars).unflatten(-1, (self.num_heads, -1))[:, None]

        score = (query * key).sum(dim=-1, keepdim=True) * key.shape[-1] ** -0.5
        if history is not None:
            valid = F.pad(history.valid, (0, 0, 0, 1), value=True)
            score = score.masked_fill(~valid[..., None, None], -torch.inf)
        mean = (score.softmax(dim=1) * value).sum(dim=1)
        return self.output(mean.flatten(-2))

    def _frame_embedding(self, dz_m: Float[Tensor, "b n"]) -> Float[Tensor, "b n dim"]:
        frames = dz_m.shape[1]
        if frames >= len(self.age):
            raise UserError(
                f"data.frames: {frames + 1} frames, but the model was built for {len(self.age)}; "
                "make model num_frames and data.frames equal"
            )
        return self.age[1 : frames + 1].flip(0) + self.dz(dz_m[..., None] / DZ_SCALE_M)
