"""Published image-encoder weights: found, verified by their SHA-256, and loaded strictly."""

import hashlib
import re
from pathlib import Path
from pickle import UnpicklingError
from urllib.error import URLError

import torch
from torch import Tensor, nn

from ..errors import UserError, reason_of

# torchvision's IMAGENET1K_V1 files, by depth; their names carry the hash's first 8 digits.
PUBLISHED = {
    18: "https://download.pytorch.org/models/resnet18-f37072fd.pth",
    50: "https://download.pytorch.org/models/resnet50-0676ba61.pth",
}
CLASSIFIER = "fc."
# Under this key a file of task=pretrain, or a checkpoint, says where it comes from.
ORIGIN = "skyshield"
# What PyTorch raises for a file that is cut, damaged, or something else.
UNREADABLE = (AttributeError, EOFError, KeyError, OSError, RuntimeError, TypeError, UnpicklingError)


def load_weights(
    backbone: nn.Module, depth: int, weights: str | None, sha256: str | None = None
) -> None:
    """Loads a state dict with torchvision's names into a backbone; ``None`` leaves it as it is.

    ``weights`` is a path, a URL (kept in torch's hub folder), or ``"imagenet"`` for the published
    file of that depth. The file must match ``sha256``, or the hash in its name
    (``<name>-<hash>.pth``); the classifier is dropped and every other name and shape must match.
    Raises `UserError` for a missing file, no network, another hash or another architecture.
    """
    if weights is None:
        return

    source = PUBLISHED[depth] if weights == "imagenet" else weights
    path = _download(source) if "://" in source else Path(source)
    if not path.is_file():
        raise UserError(f"model.backbone.weights: no file {path}; give a path, a URL or 'imagenet'")
    _verify(path, sha256)

    try:
        state, _ = read_encoder(path)
        kept = {k: v for k, v in state.items() if not k.startswith(CLASSIFIER)}
        backbone.load_state_dict(kept, strict=True)
    except RuntimeError as error:
        raise UserError(
            f"model.backbone.weights: {path.name} does not fit a ResNet-{depth} of this width "
            f"(published files need width 64): {reason_of(error)}"
        ) from error


def read_encoder(path: Path) -> tuple[dict[str, Tensor], dict]:
    """Returns the state dict of an encoder's file, and where a file of task=pretrain comes from.

    Raises `UserError` for a file that holds no weights.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        return content.get("state_dict", content), content.get(ORIGIN, {})
    except UNREADABLE as error:
        raise UserError(
            f"model.backbone.weights: {path} is no readable file of weights ({reason_of(error)}); "
            "give another one"
        ) from error


def _download(url: str) -> Path:
    path = Path(torch.hub.get_dir()) / "checkpoints" / url.rsplit("/", 1)[-1]
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            torch.hub.download_url_to_file(url, str(path), progress=False)
        except (URLError, OSError) as error:
            raise UserError(
                f"model.backbone.weights: cannot download {url} ({error}); fetch it elsewhere and "
                "give its path, or set model.backbone.weights=null"
            ) from error
    return path


def _verify(path: Path, sha256: str | None) -> None:
    # torchvision's convention: a file's name ends in the first digits of its hash.
    in_name = re.search(r"-([0-9a-f]{8,64})\.pth$", path.name)
    expected = sha256 or (in_name and in_name[1])
    actual = hashlib.sha256(path.read_bytes()).hexdigest()

    if not expected:
        raise UserError(
            f"model.backbone.weights_sha256: {path.name} carries no hash in its name; set this to "
            f"{actual} if you trust the file"
        )
    if not actual.startswith(expected.lower()):
        raise UserError(
            f"model.backbone.weights: {path} has SHA-256 {actual}, not {expected}; delete it and "
            "fetch it again"
        )
