"""Image encoders from the Hugging Face Hub, or at random from their configurations."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..errors import UserError, import_extra, reason_of
from .backbone import STRIDES, PixelNorm
from .tensors import Image

# The last four stages, whether or not a model counts its stem as one.
LAST_FOUR = [-4, -3, -2, -1]
# Keys of a configuration that describe its outputs, which are always the last four stages.
OF_OUTPUTS = ("out_indices", "out_features", "stage_names", "architectures")
CONFIG_FILES = ["config.json"]
WEIGHT_FILES = ["model.safetensors", "model-*.safetensors", "model.safetensors.index.json"]
PROBE_PIX = 64


class HuggingFaceBackbone(nn.Module):
    """The last four stages of a transformers `AutoBackbone`, at strides 4, 8, 16 and 32.

    ``name`` is a model on the Hub, such as ``facebook/convnext-tiny-224``, or a folder with its
    ``config.json`` and ``model.safetensors``; ``revision`` is a branch, tag or commit of it. With
    ``pretrained`` its weights are loaded, otherwise it starts at random. In the place of a name,
    ``config`` describes a random model, and needs no network: its ``model_type`` and whatever else
    that type takes. Only JSON and safetensors are fetched and read, never a pickle, never code.
    ``channels`` holds the channels of the four outputs, and ``built_by`` arguments that build the
    same model at random without any file.

    Raises `UserError` where transformers is missing, for a model that cannot be had or built, for
    weights that leave a part of it at random, and for stages at other strides.
    """

    def __init__(
        self,
        name: str | None = None,
        pretrained: bool = True,
        revision: str = "main",
        config: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        if config is not None and pretrained:
            raise UserError(
                "model.backbone.config: describes a random model; set model.backbone.pretrained="
                "false with it"
            )

        if config is None:
            self.model, self.called = _by_name(name, pretrained, revision), name
        else:
            transformers = _transformers()
            with _refusing(f"model.backbone.config: no backbone from {dict(config)}"):
                described = transformers.AutoConfig.for_model(**config, out_indices=LAST_FOUR)
                self.model = transformers.AutoBackbone.from_config(described)
            self.called = config["model_type"]

        self.pixel_norm = PixelNorm()
        self.channels = tuple(level.shape[1] for level in _probe(self.model, self.called))
        self.freeze_unread(finest=0)

        described = json.loads(self.model.config.to_json_string())
        described = {key: value for key, value in described.items() if key not in OF_OUTPUTS}
        self.built_by = {"name": None, "pretrained": False, "config": described}

    def freeze_unread(self, finest: int) -> None:
        """Excludes from training what leads to no feature map from the level ``finest`` on.

        An example is a last norm: it would never have a gradient, which several processes wait for.
        """
        parameters = list(self.model.requires_grad_().parameters())
        with torch.enable_grad():
            read = sum(level.sum() for level in _probe(self.model, self.called)[finest:])
        gradients = torch.autograd.grad(read, parameters, allow_unused=True)
        for parameter, gradient in zip(parameters, gradients):
            parameter.requires_grad_(gradient is not None)
        self.model.train()  # as any new module: what was loaded is in evaluation

    def forward(self, image: Image) -> list[Float[Tensor, "b _ _ _"]]:
        """Returns four feature maps, finest first; the image is normalised here, on its device.

        Raises `UserError` where a side is no multiple of 32.
        """
        return list(self.model(self.pixel_norm(image)).feature_maps)


def _transformers() -> ModuleType:
    instead = ", or take model/backbone=resnet"
    return import_extra("transformers", "encoders", "model.backbone", instead)


@contextmanager
def _refusing(what: str) -> Iterator[None]:
    """Raises `UserError` with the reason for whatever goes wrong inside: each of the library's many
    models refuses in its own way."""
    try:
        yield
    except Exception as error:
        raise UserError(f"{what}: {reason_of(error)}") from error


def _by_name(name: str | None, pretrained: bool, revision: str) -> nn.Module:
    transformers = _transformers()
    if not name:
        raise UserError("model.backbone.name: none; give a model of the Hub, a folder, or a config")
    folder = _folder(name, revision, CONFIG_FILES + (WEIGHT_FILES if pretrained else []))

    with _refusing(f"model.backbone.name: {name} is no backbone"):
        config = transformers.AutoConfig.from_pretrained(
            folder, out_indices=LAST_FOUR, trust_remote_code=False
        )
        if not pretrained:
            return transformers.AutoBackbone.from_config(config)

        # AutoBackbone's own loading asks the Hub even where all is at hand, and falls back to timm.
        with torch.device("meta"):
            kind = type(transformers.AutoBackbone.from_config(config))
        transformers.logging.set_verbosity_error()  # its report of the loading is judged below
        how = {"use_safetensors": True, "dtype": torch.float32, "output_loading_info": True}
        model, loaded = kind.from_pretrained(folder, config=config, **how)

    # A classifier, whose weights are published, has no norms at the outputs.
    if missing := sorted(key for key in loaded["missing_keys"] if "norm" not in key):
        raise UserError(
            f"model.backbone.name: the weights of {name} lack {missing[0]} and {len(missing) - 1} "
            "more of the backbone; take another model, or model.backbone.pretrained=false"
        )
    return model


def _folder(name: str, revision: str, files: list[str]) -> Path:
    """Returns the folder with a model's files on this machine, fetched if need be."""
    if Path(name).is_dir():
        return Path(name)
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(name, revision=revision, allow_patterns=files))
    except (OSError, ValueError) as error:
        raise UserError(
            f"model.backbone.name: cannot get {name} ({reason_of(error)}); check the name and the "
            "network, give a folder, or take model/backbone=resnet"
        ) from error


def _probe(model: nn.Module, name: str) -> list[Float[Tensor, "1 _ _ _"]]:
    """Returns a model's feature maps of a small image.

    Raises `UserError` where their strides are others: a configuration does not state them.
    """
    # Such as a model for one size of image only.
    with _refusing(f"model.backbone: {name} does not take {PROBE_PIX}x{PROBE_PIX} pixels"):
        maps = model.eval()(torch.zeros(1, 3, PROBE_PIX, PROBE_PIX)).feature_maps

    sizes = [tuple(level.shape[2:]) for level in maps]
    if sizes != [(PROBE_PIX // stride,) * 2 for stride in STRIDES]:
        strides = [PROBE_PIX / height for height, _ in sizes]
        raise UserError(
            f"model.backbone: the last stages of {name} are at strides {strides}, not at "
            f"{list(STRIDES)}; take a ResNet, ConvNeXt, Swin or another hierarchical model"
        )
    return list(maps)
