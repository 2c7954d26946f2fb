"""A ceiling: what the depth and the class of every pixel, seen perfectly or nearly so, tell."""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Literal, get_args

import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from src.data.batch import Batch
from src.data.clip import AUX, Clip
from src.errors import UserError
from src.geometry import VoxelGrid, pixel_centers, transform, unproject
from src.limits import require_at_least, require_choice
from src.ontology import FREE, SKY

By = Literal["image", "pixel"]
# Of the smooth error: so many waves, none of them shorter than the image.
WAVES = 8


@dataclass(frozen=True)
class TrueSight:
    """Predicts from the true depth and class of the pixels, as ``sim.save_aux=true`` keeps them.

    Each pixel is a point, which the one projection chain brings into the grid. A voxel is what most
    of its points are, the lower class id where two are equal, and free without a point. So nothing
    is known of what is hidden: a network may guess it, and exceed this.

    The points are those of the last ``frames`` of a window, as far as they exist. ``depth_error``
    is the mean absolute error of the logarithm of the depth: drawn for each ``pixel`` by itself, or
    for the ``image`` as a smooth field. ``seed`` makes the draws, the same whatever was drawn
    before.

    Raises `UserError` for settings out of range, and for clips without what was kept.
    """

    clips: Mapping[str, Clip]
    step: int
    frames: int = 1
    depth_error: float = 0.0
    by: By = "image"
    seed: int = 0

    def __post_init__(self) -> None:
        require_choice("task.by", self.by, get_args(By))
        require_at_least(0, "task", vars(self), "depth_error")
        for clip in self.clips.values():
            if not (clip.folder / AUX).is_file():
                raise UserError(
                    f"{clip.folder}: has no {AUX}, which holds the depth of the pixels; generate "
                    "the dataset with sim.save_aux=true"
                )

    def __call__(self, batch: Batch) -> UInt8[Tensor, "b X Y Z"]:
        """Returns the labels of the current frames of a batch."""
        labels = []
        for row, (clip_id, now) in enumerate(zip(batch["clip"], batch["frame"])):
            clip = self.clips[clip_id]
            votes = sum(
                self._votes(clip, int(now), age, {key: batch[key][row] for key in GEOMETRY})
                for age in range(self.frames)
                if batch["history_valid"][row, -1 - age]
            )
            most, class_id = votes.max(dim=0)
            labels.append(torch.where(most > 0, class_id, FREE).to(torch.uint8))
        return torch.stack(labels)

    def _votes(
        self, clip: Clip, now: int, age: int, window: Mapping[str, Tensor]
    ) -> Int[Tensor, "8 X Y Z"]:
        """Counts the points of each class in every voxel of the current frame's grid."""
        frame = now - age * self.step
        depth_m, class_id = (torch.from_numpy(clip.aux(name, frame)) for name in ("depth", "class"))
        if self.depth_error:
            depth_m = depth_m * self._error(clip, frame).exp()

        hit = class_id != SKY
        pix = pixel_centers(clip.meta.width, clip.meta.height)[hit].double()
        lens = window["pix_from_camera"][-1 - age].double()
        points_camera = unproject(pix, depth_m[hit].double(), lens)
        occ_from_camera = (
            window["occ_from_past_occ"][-1 - age].double()
            @ window["occ_from_body"][-1 - age].double()
            @ window["body_from_camera"].double()
        )
        return counted(transform(occ_from_camera, points_camera), class_id[hit], clip.meta.grid)

    def _error(self, clip: Clip, frame: int) -> Float[Tensor, "H W"]:
        """Returns the error of the logarithm of the depth."""
        digits = f"{self.seed} {clip.clip_id} {frame}".encode()
        generator = torch.Generator().manual_seed(
            int.from_bytes(sha256(digits).digest()[:7], "big")
        )
        size = clip.meta.height, clip.meta.width
        noise = torch.randn(size, generator=generator)
        if self.by == "image":
            noise = smooth_field(*size, generator)
        return noise * (self.depth_error / noise.abs().mean())


# What of a batch says where each frame of a window looked.
GEOMETRY = ("pix_from_camera", "occ_from_past_occ", "occ_from_body", "body_from_camera")


def counted(
    points: Float[Tensor, "n 3"], class_id: UInt8[Tensor, "n"], grid: VoxelGrid
) -> Int[Tensor, "8 X Y Z"]:
    """Counts the points of each class in every voxel; those outside the grid are left out."""
    index, inside = grid.index_of(points)
    cells = class_id[inside].long(), *index[inside].T
    counts = torch.zeros(FREE, *grid.shape, dtype=torch.long)
    return counts.index_put_(cells, torch.tensor(1), accumulate=True)


def smooth_field(height: int, width: int, generator: torch.Generator) -> Float[Tensor, "H W"]:
    """Returns a sum of random waves over the image, each at least as long as the image."""
    cycles_x, cycles_y = 2 * torch.rand(2, WAVES, 1, 1, generator=generator) - 1
    phase = torch.rand(WAVES, 1, 1, generator=generator)
    x = torch.linspace(0, 1, width)
    y = torch.linspace(0, 1, height)[:, None]
    return (2 * torch.pi * (cycles_x * x + cycles_y * y + phase)).cos().sum(dim=0)
