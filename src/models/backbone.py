"""ResNet image encoder (the paper's Phi_img), whose parameter names are torchvision's."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError, reason_of
from .tensors import Image
from .weights import load_encoder

# Pixels of the image per pixel of each feature level, finest first.
STRIDES = (4, 8, 16, 32)
IMAGE_MULTIPLE = STRIDES[-1]

# Mean and deviation of red, green and blue in ImageNet's images, as shares of 255.
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class PixelNorm(nn.Module):
    """Normalises pixels for networks trained on ImageNet: less its mean, over its deviation."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", 255 * torch.tensor(IMAGENET_MEAN), persistent=False)
        self.register_buffer("std", 255 * torch.tensor(IMAGENET_STD), persistent=False)

    def forward(self, image: Image) -> Float[Tensor, "b 3 h w"]:
        """Raises `UserError` where a side is no multiple of 32."""
        height, width = image.shape[-2:]
        if height % IMAGE_MULTIPLE or width % IMAGE_MULTIPLE:
            raise UserError(
                f"image: {width}x{height} pixels; make both sides multiples of {IMAGE_MULTIPLE}"
            )

        x = (image.to(self.mean.dtype) - self.mean[:, None, None]) / self.std[:, None, None]
        return x.contiguous(memory_format=torch.channels_last)


class Block(nn.Module):
    """Convolutions and a shortcut around them: two of 3x3 (ResNet-18), or a bottleneck of 1x1, 3x3
    and 1x1 (ResNet-50). The first 3x3 carries the stride."""

    recomputable = True

    def __init__(
        self, in_channels: int, channels: Sequence[int], kernels: Sequence[int], stride: int
    ) -> None:
        super().__init__()
        strides = [stride if n == kernels.index(3) else 1 for n in range(len(kernels))]
        pairs = zip((in_channels, *channels), channels)
        for n, (pair, kernel, step) in enumerate(zip(pairs, kernels, strides), start=1):
            convolution = nn.Conv2d(*pair, kernel, step, kernel // 2, bias=False)
            self.add_module(f"conv{n}", convolution)
            self.add_module(f"bn{n}", nn.BatchNorm2d(pair[1]))
        self.relu = nn.ReLU(inplace=True)
        self.downsample = shortcut(in_channels, channels[-1], stride)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        y = self.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        if hasattr(self, "conv3"):
            y = self.bn3(self.conv3(self.relu(y)))
        return self.relu(y + self.downsample(x))


def shortcut(in_channels: int, out_channels: int, stride: int) -> nn.Module:
    """Returns the identity, or a 1x1 projection where a block changes the shape."""
    if stride == 1 and in_channels == out_channels:
        return nn.Identity()
    return nn.Sequential(
        nn.Conv2d(in_channels, out_channels, 1, stride, bias=False), nn.BatchNorm2d(out_channels)
    )


# Sides of a block's convolutions, how much wider its last one is, and the number of blocks of each
# stage, by depth (He et al. 2016, Table 1).
LAYOUTS = {18: ((3, 3), 1, (2, 2, 2, 2)), 50: ((1, 3, 1), 4, (3, 4, 6, 3))}


class ResNet(nn.Module):
    """ResNet-18 or -50 that returns its four stages, at strides 4, 8, 16 and 32.

    ``depth`` is 18 or 50; ``width`` is the channels of the first stage (64 is the standard one).
    ``weights`` and ``weights_sha256`` go to `load_encoder`; with ``None`` it starts at random.
    ``channels`` holds the channels of the four outputs, and ``built_by`` the arguments that build
    one to be filled from a checkpoint. Raises `UserError` for another depth.
    """

    built_by: ClassVar = {"weights": None, "weights_sha256": None}

    def __init__(
        self,
        depth: int = 50,
        width: int = 64,
        weights: str | None = None,
        weights_sha256: str | None = None,
    ) -> None:
        super().__init__()
        if depth not in LAYOUTS:
            raise UserError(f"size.backbone_depth: {depth} is not one of {sorted(LAYOUTS)}")

        kernels, expansion, repeats = LAYOUTS[depth]
        self.channels = tuple(width * 2**stage * expansion for stage in range(4))
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, 2, 1)

        in_channels = width
        for stage, repeat in enumerate(repeats):
            channels = [width * 2**stage] * (len(kernels) - 1) + [self.channels[stage]]
            blocks = []
            for index in range(repeat):
                stride = 2 if stage > 0 and index == 0 else 1
                blocks.append(Block(in_channels, channels, kernels, stride))
                in_channels = channels[-1]
            self.add_module(f"layer{stage + 1}", nn.Sequential(*blocks))

        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        self.pixel_norm = PixelNorm()
        load_encoder(self, depth, weights, weights_sha256)

    def forward(self, image: Image) -> list[Float[Tensor, "b _ _ _"]]:
        """Returns four feature maps, finest first; the image is normalised here, on its device.

        Raises `UserError` where a side is no multiple of 32.
        """
        x = self.pixel_norm(image)
        x = self.maxpool(self.relu(self.bn1(self.conv1(x))))

        features = []
        for stage in (self.layer1, self.layer2, self.layer3, self.layer4):
            x = stage(x)
            features.append(x)
        return features


def require_maps(backbone: nn.Module) -> None:
    """Raises `UserError` for an image encoder that does not give what the neck reads."""
    side, name = 64, type(backbone).__name__
    try:
        maps = backbone(torch.zeros(2, 3, side, side, dtype=torch.uint8))
        shapes = [list(each.shape) for each in maps]
    except Exception as error:  # whatever a class of a user's own raises
        raise UserError(
            f"model/backbone: {name} fails on images, which are uint8 [B, 3, H, W] of 0 to 255: "
            f"{reason_of(error)}"
        ) from error

    wanted = [[2, c, side // s, side // s] for c, s in zip(backbone.channels, STRIDES)]
    if shapes != wanted:
        raise UserError(
            f"model/backbone: {name} gives maps {shapes} of images [2, 3, {side}, {side}], and its "
            f"channels at strides {', '.join(map(str, STRIDES))} would be {wanted}"
        )
