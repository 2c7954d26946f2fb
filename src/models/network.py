"""SkyOcc (Sec. 4 of the paper): a front image and its history to a semantic occupancy volume."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from .decoder import PillarDecoder
from .encoder import PillarEncoder
from .history import History
from .neck import FPN

ATTITUDE_SCALE_RAD = 0.3
SPEED_SCALE_MPS = 10.0
"""Typical sizes, by which the auxiliary metadata are divided."""


class SkyOcc(nn.Module):
    """Image encoder, FPN, pillar encoder and voxel decoder.

    A past frame's pillars come from that frame alone, so a stream that keeps what `encode` gave for
    each frame computes exactly what `forward` computes from the queue.

    ``backbone`` is a `ResNet`, or any module with its call and ``channels``. With ``metadata`` the
    measured attitude and velocity are added to the pillars after the lifting: before it, deformable
    offsets could learn the tilt. With ``history_grad`` gradients also flow into the past frames.
    """

    def __init__(
        self,
        backbone: nn.Module,
        encoder: PillarEncoder,
        decoder: PillarDecoder,
        metadata: bool = True,
        history_grad: bool = False,
    ) -> None:
        super().__init__()
        dim = encoder.dim
        self.backbone, self.encoder, self.decoder = backbone, encoder, decoder
        self.neck = FPN(backbone.channels, dim)
        self.metadata = (
            nn.Sequential(nn.Linear(5, dim), nn.ReLU(), nn.Linear(dim, dim)) if metadata else None
        )
        self.history_grad = history_grad
        self.to(memory_format=torch.channels_last)

    def forward(self, batch: Mapping[str, Tensor]) -> Float[Tensor, "b 9 x y z"]:
        """Logits of a batch of `src.data`, whose frames are oldest first and the current one last.

        Raises `UserError` for image sides that are no multiples of 32, and for more frames than the
        encoder was built for.
        """
        pillars = self.encode(
            batch["image"][:, -1],
            batch["pix_from_camera"][:, -1],
            batch["body_from_camera"],
            batch["occ_from_body"][:, -1],
            self._encode_history(batch),
        )
        return self.decode(pillars, batch["attitude_rad"], batch["velocity_mps"])

    def encode(
        self,
        image: UInt8[Tensor, "b 3 h w"],
        pix_from_camera: Float[Tensor, "b 3 3"],
        body_from_camera: Float[Tensor, "b 4 4"],
        occ_from_body: Float[Tensor, "b 4 4"],
        history: History | None = None,
    ) -> Float[Tensor, "b p dim"]:
        """Pillars of one frame. Without history they are what later frames take as history."""
        height, width = image.shape[-2:]
        references = self.encoder.references(
            occ_from_body, body_from_camera, pix_from_camera, (width, height)
        )
        return self.encoder(self.neck(self.backbone(image)), references, history)

    def decode(
        self,
        pillars: Float[Tensor, "b p dim"],
        attitude_rad: Float[Tensor, "b 2"],
        velocity_mps: Float[Tensor, "b 3"],
    ) -> Float[Tensor, "b 9 x y z"]:
        """Logits of the current frame; attitude is roll and pitch, velocity is in its occ frame."""
        if self.metadata is not None:
            scaled = [attitude_rad / ATTITUDE_SCALE_RAD, velocity_mps / SPEED_SCALE_MPS]
            pillars = pillars + self.metadata(torch.cat(scaled, dim=-1).float())[:, None]
        return self.decoder(pillars)

    def _encode_history(self, batch: Mapping[str, Tensor]) -> History | None:
        """Pillars of every past frame that exists.

        Batch normalisation uses its running statistics there: so a past frame's pillars are the
        ones that a stream would have cached, and each step updates the statistics once, from the
        current frames only.
        """
        valid = batch["history_valid"][:, :-1]
        if not valid.any():
            return None
        gradient = nullcontext() if self.history_grad else torch.no_grad()
        with gradient, running_statistics(self.backbone):
            # A step at a time: what one step touches stays in the cache, and memory stays low.
            steps = [self._encode_step(batch, step) for step in range(valid.shape[1])]
        return History(torch.stack(steps, dim=1), batch["occ_from_past_occ"][:, :-1], valid)

    def _encode_step(self, batch: Mapping[str, Tensor], step: int) -> Float[Tensor, "b p dim"]:
        """Pillars of one frame of the queue; zero, and not computed, where it does not exist."""
        rows = batch["history_valid"][:, step].nonzero()[:, 0]
        pillars = self.encoder.query.new_zeros(
            len(batch["image"]), *self.encoder.query.flatten(0, 1).shape
        )
        if len(rows) == 0:
            return pillars
        encoded = self.encode(
            batch["image"][rows, step],
            batch["pix_from_camera"][rows, step],
            batch["body_from_camera"][rows],
            batch["occ_from_body"][rows, step],
        )
        return pillars.index_copy(0, rows, encoded.to(pillars.dtype))


@contextmanager
def running_statistics(module: nn.Module) -> Iterator[None]:
    """Batch normalisation inside uses its running statistics, and leaves them as they are."""
    norms = [m for m in module.modules() if isinstance(m, _BatchNorm) and m.training]
    for norm in norms:
        norm.eval()
    try:
        yield
    finally:
        for norm in norms:
            norm.train()
