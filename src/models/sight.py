"""What each pixel sees: its class, and how far away that is, as distributions.

The depth is learnt from the generator's own (as in BEVDepth, Li et al. 2023): a second task, which
teaches the image encoder.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from torch import Tensor, nn

from ..errors import UserError
from ..geometry import inverse
from ..ontology import NUM_CLASSES, UNKNOWN
from ..parallax import FAR_M, NEAR_M, Parallax
from .backbone import STRIDES
from .references import References, rays_camera
from .tensors import Scalar


class Sight(NamedTuple):
    """Logits of every pixel of the finest level.

    ``classes`` has the eight occupied ones and, in the place of free, the sky. ``depth`` has bins
    of the z-depth from `NEAR_M` to `FAR_M` and, as the last, what lies beyond.
    """

    classes: Float[Tensor, "b 9 h w"]
    depth: Float[Tensor, "b bins_and_beyond h w"]

    def depth_m(self) -> Float[Tensor, "b h w"]:
        """Returns the median depth in metres, without the probability of the bin beyond `FAR_M`.

        Within its bin the logarithm of the depth is taken to be uniform.
        """
        share = self.depth[:, :-1].float().softmax(dim=1)
        bins = share.shape[1]
        nearer = share.cumsum(dim=1)
        median = (nearer < 0.5).sum(dim=1, keepdim=True).clamp(max=bins - 1)
        beyond = (nearer.gather(1, median) - 0.5) / share.gather(1, median)
        place = (median + 1 - beyond.clamp(0, 1))[:, 0]
        return NEAR_M * (FAR_M / NEAR_M) ** (place / bins)


class Matching(nn.Module):
    """Three 3x3x3 convolutions of a cost volume, of ``width`` channels between them.

    Each is a plain 3x3 one of every bin, with three outputs: for the bin behind it, for itself and
    for the one before it. PyTorch's own in 3-D is ten times slower for a single frame on a CPU.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        widths = (1, width, width, 1)
        self.layers = nn.ModuleList(
            nn.Conv2d(before, 3 * after, 3, padding=1) for before, after in pairwise(widths)
        )

    def forward(self, volume: Float[Tensor, "b bins h w"]) -> Float[Tensor, "b bins h w"]:
        x = volume[:, :, None]
        for number, layer in enumerate(self.layers):
            of_bins = layer((torch.relu(x) if number else x).flatten(0, 1))
            behind, x, before = of_bins.unflatten(0, volume.shape[:2]).chunk(3, dim=2)
            x = x + F.pad(behind[:, :-1], (0, 0, 0, 0, 0, 0, 1, 0))
            x = x + F.pad(before[:, 1:], (0, 0, 0, 0, 0, 0, 0, 1))
        return x[:, :, 0]


class SightHead(nn.Module):
    """Two convolutions from the finest features, and from where each pixel looks, to a `Sight`.

    A pixel is told its ray's elevation and the depth at which the ray meets the ground plane, where
    the pillars stand on that: both as the rung's own projection has them. One output says how
    likely it is the ground that the pixel sees, which adds to the logits around that depth.

    With a ``parallax`` the frame's cost volume is added twice: to the features by a convolution
    over its bins as channels, and to the depth's logits by three thin ones in 3-D.

    ``dim`` is the width of the features, ``weight`` the factor of the head's two losses, and
    ``class_weights`` [9] what a pixel of each class weighs in the first one. Raises `UserError` for
    another number of them, or one that is not above 0, and for a ``parallax`` of other bins.
    """

    stride = STRIDES[0]

    def __init__(
        self,
        dim: int,
        bins: int = 48,
        weight: float = 1.0,
        class_weights: Sequence[float] = (1.0,) * NUM_CLASSES,
        parallax: Parallax | None = None,
    ) -> None:
        super().__init__()
        if len(class_weights) != NUM_CLASSES or not min(class_weights) > 0:
            raise UserError(
                f"model.sight.class_weights: {list(class_weights)} are not {NUM_CLASSES} numbers "
                "above 0; give one for each class"
            )

        if parallax is not None and parallax.bins != bins:
            raise UserError(
                f"data.parallax.bins: {parallax.bins}, and model.sight.bins has {bins}; give one "
                "number for both"
            )

        self.bins, self.weight, self.parallax = bins, weight, parallax
        self.register_buffer(
            "class_weights", torch.tensor([*class_weights], dtype=torch.float), persistent=False
        )

        self.ray = nn.Conv2d(4, dim, 1)
        self.layers = nn.Sequential(
            nn.Conv2d(dim, dim, 3, padding=1), nn.ReLU(), nn.Conv2d(dim, NUM_CLASSES + bins + 2, 1)
        )
        if parallax is not None:
            self.volume = nn.Conv2d(bins, dim, 3, padding=1)
            self.matching = Matching(4)

    def forward(
        self,
        feature: Float[Tensor, "b dim h w"],
        references: References,
        has_ground: bool,
        volume: UInt8[Tensor, "b bins h w"] | None = None,
    ) -> Sight:
        """Returns class and depth logits of the pixels of the finest level."""
        height, width = feature.shape[-2:]
        # Autocast would round geometry to 8 bits.
        with torch.autocast(feature.device.type, enabled=False):
            ray, ground_m, meets = rays(references, width, height, self.stride, has_ground)
        feature = feature + self.ray(ray)
        if self.parallax is not None:
            agreement = volume.to(feature.dtype) / 255
            feature = feature + self.volume(agreement)
        out = self.layers(torch.relu(feature))

        classes, depth, is_ground = out.float().split([NUM_CLASSES, self.bins + 1, 1], dim=1)
        bins = torch.arange(self.bins + 1, device=depth.device)[:, None, None] + 0.5
        near_ground = (-0.5 * (bins - place_of(ground_m, self.bins)) ** 2).exp() * meets
        if self.parallax is not None:
            matched = self.matching(agreement).float()
            depth = depth + F.pad(matched, (0, 0, 0, 0, 0, 1))
        # One is what it begins with: without a look most pixels see the ground.
        return Sight(classes, depth + 4 * near_ground * (1 + is_ground))

    def losses(self, sight: Sight, batch: Mapping[str, Tensor]) -> dict[str, Scalar]:
        """Returns the cross-entropies of class and depth of the pixels, weighted."""
        depth_m = batch["pixel_depth_m"]
        place = place_of(depth_m, self.bins).floor().long().clamp(max=self.bins - 1)
        place = torch.where(depth_m < FAR_M, place, self.bins)
        classes = batch["pixel_class"].long()
        of_class = sight.classes.sum() * 0
        if (classes != UNKNOWN).any():
            weights = self.class_weights
            of_class = F.cross_entropy(sight.classes, classes, weights, ignore_index=UNKNOWN)
        of_depth = F.cross_entropy(sight.depth, place)
        return {"pixel_class": self.weight * of_class, "pixel_depth": 0.5 * self.weight * of_depth}


def place_of(depth_m: Float[Tensor, "*n"], bins: int) -> Float[Tensor, "*n"]:
    """Returns a depth in bins, held between the first and the last edge."""
    share = (depth_m.clamp(NEAR_M, FAR_M) / NEAR_M).log() / math.log(FAR_M / NEAR_M)
    return share * bins


def rays(
    references: References, width: int, height: int, stride: int, has_ground: bool
) -> tuple[Float[Tensor, "b 4 h w"], Float[Tensor, "b 1 h w"], Bool[Tensor, "b 1 h w"]]:
    """Returns the four inputs of each pixel of a level, the depth in metres at which its ray meets
    the ground plane, and a mask of the rays that meet it within `FAR_M`."""
    volume_from_camera = inverse(references.camera_from_volume)
    points_camera = rays_camera(width, height, stride, references.pix_from_camera)
    ray = points_camera @ volume_from_camera[:, :3, :3].transpose(1, 2)

    # Of a ray whose z-depth is one: how far it comes down.
    falls = -ray[..., 2]
    above_m = volume_from_camera[:, 2, 3, None].expand_as(falls)
    ground_m = above_m / falls.clamp(min=1e-3)
    meets = (falls > 0) & (ground_m > NEAR_M) & (ground_m < FAR_M) & has_ground
    told_m = torch.where(meets, ground_m, FAR_M)
    elevation = falls / ray.norm(dim=-1)

    told = [told_m.log() - 2.5, -2 * elevation, meets.float(), above_m * (0.1 * has_ground)]
    by_ray = torch.stack(told, dim=1), ground_m[:, None], meets[:, None]
    return tuple(each.unflatten(2, (height, width)) for each in by_ray)


def depth_error(
    sight: Sight, depth_m: Float[Tensor, "b h w"]
) -> tuple[Float[Tensor, "b h w"], Float[Tensor, "b h w"]]:
    """Returns the absolute error of the logarithm of the depth, and 1 for the pixels that count:
    those that see something nearer than `FAR_M`. The others are 0."""
    error = (sight.depth_m().log() - depth_m.clamp(NEAR_M, FAR_M).log()).abs()
    return error, (depth_m < FAR_M).to(error)
