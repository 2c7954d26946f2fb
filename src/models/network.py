"""SkyOcc (Sec. 4 of the paper): a front image and its history to a semantic occupancy volume."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import Literal, NamedTuple, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import inverse
from ..limits import require_choice
from ..parallax import Parallax
from .checkpointing import recompute_in_backward, running_statistics
from .decoder import PillarDecoder
from .encoder import PillarEncoder
from .evidence import Evidence, VoxelEvidence
from .ground import GroundVolume
from .history import History
from .metadata import Metadata
from .neck import FPN
from .references import References
from .sight import Sight, SightHead
from .tensors import Features, Logits, Pillars

HistoryKind = Literal["queue", "recursive"]


class EncodedFrame(NamedTuple):
    """One frame by itself: its feature maps, its references, and its pillars from these alone; and,
    of the current one, what its pixels see and that as evidence, where the network says it."""

    features: Features
    references: References
    pillars: Pillars
    sight: Sight | None = None
    evidence: VoxelEvidence | None = None


class Step(NamedTuple):
    """The output for a frame: logits, the pillars that later frames use as history, and class and
    depth of the pixels if the network predicts them."""

    logits: Logits
    pillars: Pillars
    sight: Sight | None


class SkyOcc(nn.Module):
    """Image encoder, FPN, pillar encoder and voxel decoder.

    ``history`` says what a frame leaves behind for later ones. ``"queue"``: the pillars that come
    from that frame alone, so a stream that keeps them computes exactly what `forward` computes
    from the queue. ``"recursive"`` (BEVFormer's): its fused pillars, which hold the frames before
    it as well; a stream then looks back further than `forward`, which begins at the queue's start.

    ``backbone`` is a `ResNet`, or any module with its call and ``channels``. ``metadata`` names the
    measurements (`Metadata`) that are added to the pillars after the lifting: before it, deformable
    offsets could learn the tilt. With ``metadata_first``, for a network without history, they are
    added to the queries, as in BEVFormer. With ``ground`` the encoder's and the decoder's grid
    stands on the ground plane, else it is the occ frame's. ``sight`` says what the pixels see,
    which is a task of its own in training, and ``evidence`` reads that for the voxels. With
    ``history_grad`` gradients also flow into the past frames. With ``checkpointing`` training keeps
    less in memory and computes blocks and layers twice.

    Raises `UserError` for another ``history``, for other ``metadata``, for ``metadata_first`` with
    a history, for a lifting that reads no level as fine as the ``sight``, and for ``evidence``
    without a ``sight`` of as many bins.
    """

    def __init__(
        self,
        backbone: nn.Module,
        encoder: PillarEncoder,
        decoder: PillarDecoder,
        history: HistoryKind = "queue",
        metadata: Sequence[str] = ("attitude", "velocity"),
        metadata_first: bool = False,
        ground: GroundVolume | None = None,
        sight: SightHead | None = None,
        evidence: Evidence | None = None,
        history_grad: bool = False,
        checkpointing: bool = False,
    ) -> None:
        super().__init__()
        require_choice("model.history", history, get_args(HistoryKind))

        if not isinstance(getattr(backbone, "channels", None), list | tuple):
            raise UserError(
                f"model/backbone: {type(backbone).__name__} does not state its channels, a list of "
                "those of the maps at strides 4, 8, 16 and 32 (docs/extending.md)"
            )
        dim = encoder.dim
        self.backbone, self.encoder, self.decoder = backbone, encoder, decoder
        self.neck = FPN(backbone.channels, dim, encoder.reads_strides)
        # What has no gradient, other processes of a training would wait for.
        if hasattr(backbone, "freeze_unread"):
            backbone.freeze_unread(self.neck.finest)
        self.metadata = Metadata(dim, metadata) if metadata != [] else None
        self.metadata_first = metadata_first
        # Only those of the current frame are measured, and a past one is lifted with its own.
        if metadata_first and encoder.num_frames > 1:
            raise UserError("model.metadata_first: true is without history; give data.frames=1")
        if sight is not None and sight.stride not in encoder.reads_strides:
            raise UserError(
                f"model/sight: what pixels see is read off stride {sight.stride}, and model/lift "
                f"reads {sorted(encoder.reads_strides)}; give model/sight=off, or "
                f"model.encoder.lift.stride={sight.stride}"
            )
        if evidence is not None and (sight is None or sight.bins != evidence.bins):
            raise UserError(
                "model/evidence: on reads the pixels' class and depth; give model/sight=on with "
                "model.evidence.bins=model.sight.bins, or model/evidence=off"
            )
        self.ground, self.sight, self.evidence = ground, sight, evidence
        self.history, self.history_grad = history, history_grad
        # Of a trained network, whose logits it maps; a checkpoint may hold one.
        self.calibrator: nn.Module | None = None

        for parameter in self.parameters():
            if parameter.ndim == 4:
                parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
        if checkpointing:
            recompute_in_backward(self)

    @property
    def pillar_shape(self) -> tuple[int, int]:
        """Returns number and width of the pillars of a frame."""
        return self.encoder.query.shape[:2].numel(), self.encoder.dim

    @property
    def past_frames(self) -> int:
        """The largest number of frames before the current one in the history of a `step`."""
        queue = self.encoder.num_frames - 1
        return min(queue, 1) if self.history == "recursive" else queue

    @property
    def parallax(self) -> Parallax | None:
        """What compares a frame with past ones for this network; ``None`` without it."""
        return None if self.sight is None else self.sight.parallax

    @property
    def heights_m(self) -> tuple[float, float] | None:
        """The lowest and the highest flight above the ground that it can be asked about; ``None``
        where it does not look at the height."""
        return None if self.ground is None else self.ground.heights_m

    @property
    def device(self) -> torch.device:
        """The device of the parameters."""
        return self.encoder.query.device

    def forward(self, batch: Mapping[str, Tensor]) -> Logits:
        """Returns the logits [B, 9, X, Y, Z] of a batch of `src.data`.

        Raises `UserError` for image sides that are no multiples of 32, and for more frames than the
        encoder was built for.
        """
        return self.step(batch, self.history_of(batch)).logits

    def history_of(self, batch: Mapping[str, Tensor]) -> History | None:
        """Computes the history of a batch: the pillars of each past frame that exists in its queue.

        Batch normalisation uses its running statistics there: so a past frame's pillars are the
        ones that a stream would have cached, and each step updates the statistics once, from the
        current frames only.
        """
        valid = batch["history_valid"][:, :-1]
        if valid.shape[1] == 0:
            return None

        exists = valid.cpu()  # once: to ask a GPU frame by frame would stall it each time
        gradient = nullcontext() if self.history_grad else torch.no_grad()
        steps: list[Tensor] = []
        with gradient, running_statistics(self.backbone):
            # A step at a time: what one step touches stays in the cache, and memory stays low.
            for at in range(valid.shape[1]):
                rows = exists[:, at].nonzero()[:, 0].to(valid.device)
                steps.append(self._encode_past(batch, at, rows, steps))

        return History.of(steps[-self.past_frames :], batch)

    def step(self, batch: Mapping[str, Tensor], history: History | None) -> Step:
        """Computes the logits of a batch's current frames, and the pillars for later ones."""
        frame = self.encode(batch, -1)
        fused = self.fuse(frame, history)
        logits = self.decode(fused, batch, frame.evidence)
        return Step(logits, self.carried(frame, fused), frame.sight)

    def encode(
        self, batch: Mapping[str, Tensor], at: int, rows: Tensor | slice = slice(None)
    ) -> EncodedFrame:
        """Returns frame ``at`` of the queue by itself, for some rows of the batch."""
        image, height_m = batch["image"][rows, at], None
        if self.ground is not None:
            height_m = batch["height_m"]
            if at >= 0:  # a past one, which flew so much higher
                height_m = height_m + batch["occ_from_past_occ"][:, at, 2, 3]
            height_m = height_m[rows]

        camera = (
            batch["occ_from_body"][rows, at],
            batch["body_from_camera"][rows],
            batch["pix_from_camera"][rows, at],
            (image.shape[-1], image.shape[-2]),
            height_m,
        )
        references = self.encoder.references(*camera)
        features, sight, evidence = self.neck(self.backbone(image)), None, None
        # What a past frame sees would not be read.
        if at == -1 and self.sight is not None:
            volume = None if self.parallax is None else batch["parallax"][rows]
            sight = self.sight(features[0], references, self.ground is not None, volume)
        if at == -1 and self.evidence is not None:
            evidence = self.evidence.of(sight, self.evidence.voxels(*camera), self.sight.stride)
        told = self._told(batch) if self.metadata_first else None
        pillars = self.encoder.frame(features, references, told)
        return EncodedFrame(features, references, pillars, sight, evidence)

    def fuse(self, frame: EncodedFrame, history: History | None) -> Pillars:
        """Fuses the pillars of a frame with its history."""
        if history is None and self.training:
            history = self.encoder.no_history(frame.pillars)
        return self.encoder.fuse(frame.pillars, frame.features, frame.references, history)

    def carried(self, frame: EncodedFrame, fused: Pillars) -> Pillars:
        """Returns the pillars that later frames take as their history."""
        return fused if self.history == "recursive" else frame.pillars

    def decode(
        self, pillars: Pillars, batch: Mapping[str, Tensor], evidence: VoxelEvidence | None = None
    ) -> Logits:
        """Returns the logits of the current frame, from its pillars and measurements of the UAV."""
        if not self.metadata_first and (told := self._told(batch)) is not None:
            pillars = pillars + told
        if evidence is not None:
            pillars = pillars + self.evidence.pillars(evidence)
        logits = self.decoder(pillars)
        if evidence is not None:
            logits = logits + self.evidence.logits(evidence, tuple(logits.shape[2:4]))
        if self.ground is not None:
            logits = self.ground(logits, batch["height_m"])
        return logits if self.calibrator is None else self.calibrator(logits)

    def _told(self, batch: Mapping[str, Tensor]) -> Float[Tensor, "b 1 dim"] | None:
        return None if self.metadata is None else self.metadata(batch)[:, None]

    def _encode_past(
        self, batch: Mapping[str, Tensor], at: int, rows: Tensor, before: Sequence[Tensor]
    ) -> Pillars:
        """Returns the pillars of frame ``at``, in the rows of the batch that have one.

        In the others they are zero, and not computed.
        """
        pillars = self.encoder.query.new_zeros(len(batch["image"]), *self.pillar_shape)
        if len(rows) == 0:
            return pillars

        frame = self.encode(batch, at, rows)
        carried = frame.pillars
        if self.history == "recursive":
            carried = self.fuse(frame, self._state(batch, at, rows, before))
        return pillars.index_copy(0, rows, carried.to(pillars.dtype))

    def _state(
        self, batch: Mapping[str, Tensor], at: int, rows: Tensor, before: Sequence[Tensor]
    ) -> History | None:
        """Returns the pillars of the frame before ``at`` as a history, for the recursive kind."""
        if at == 0:
            return None

        # The batch knows the motion to the current frame alone; here it is that to frame `at`.
        occ_from_last, occ_from_this = batch["occ_from_past_occ"][rows, at - 1 : at + 1].unbind(1)
        return History(
            before[-1][rows, None],
            (inverse(occ_from_this) @ occ_from_last)[:, None],
            batch["history_valid"][rows, at - 1 : at],
        )
