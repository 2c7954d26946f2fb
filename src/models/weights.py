"""What an image encoder begins with: found, verified by its SHA-256, and loaded strictly."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from pickle import UnpicklingError
from urllib.error import URLError

import torch
from torch import Tensor, nn

from ..errors import UserError, reason_of, way_out_of

# torchvision's IMAGENET1K_V1 files, by depth; their names carry the hash's first 8 digits.
PUBLISHED = {
    18: "https://download.pytorch.org/models/resnet18-f37072fd.pth",
    50: "https://download.pytorch.org/models/resnet50-0676ba61.pth",
}
CLASSIFIER = "fc."
# Under this key a checkpoint says where it comes from.
ORIGIN = "skyshield"
# How the names of an image encoder begin in a checkpoint.
ENCODER = "network.backbone."
# What decides where a clip of a name flies, with the values of before there was a choice.
DRAWN = {"seed": 0, "town_seeds": 1, "flight": {}}
# What PyTorch raises for a file that is cut, damaged, or something else.
UNREADABLE = (AttributeError, EOFError, LookupError, OSError, RuntimeError, TypeError, ValueError)
UNREADABLE += (UnpicklingError,)


def load_encoder(
    backbone: nn.Module, depth: int, weights: str | None, sha256: str | None = None
) -> None:
    """Loads a state dict with torchvision's names into a backbone; ``None`` leaves it as it is.

    ``weights`` is a path, a URL (kept in torch's hub folder), or ``"imagenet"`` for the published
    file of that depth. Of a checkpoint its image encoder is taken. The file must match ``sha256``,
    or the hash in its name (``<name>-<hash>.pth`` or ``.ckpt``); the classifier is dropped and
    every other name and shape must match. Raises `UserError` for a missing file, no network,
    another hash or another architecture.
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
    """Returns the state dict of an image encoder, and where it comes from if a checkpoint holds it.

    Raises `UserError` for a file that holds no weights.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        state, origin = content.get("state_dict", content), content.get(ORIGIN, {})
        if origin:
            named = {name.removeprefix(ENCODER): name for name in state if name.startswith(ENCODER)}
            state = {own: state[name] for own, name in named.items()}
        return state, origin
    except UNREADABLE as error:
        way_out = way_out_of(error, "give another one", path)
        raise UserError(
            f"model.backbone.weights: {path} is no readable file of weights ({reason_of(error)}); "
            f"{way_out}"
        ) from error


def require_unseen(
    weights: str | None, dataset: str, sim: Mapping, test_clips: Iterable[str]
) -> None:
    """Raises `UserError` where an encoder begins with a checkpoint that was `trained_on` one of the
    ``test_clips``, whose labels it has learnt.

    Nothing is known of a published file.
    """
    if not Path(weights or "").is_file():
        return

    _, origin = read_encoder(Path(weights))
    # A file of the former task=pretrain has no configuration, and is refused by its clips.
    if origin and (
        seen := trained_on(origin["dataset"], origin.get("config", {}), dataset, sim, test_clips)
    ):
        raise UserError(
            f"model.backbone.weights: {weights} was trained on {seen[0]}, which this run holds out "
            f"for its test ({len(seen)} such clips); begin with a run of the same split"
        )


def trained_on(
    own_dataset: str, config: Mapping, dataset: str, sim: Mapping, clips: Iterable[str]
) -> list[str]:
    """Returns those of the ``clips`` that a run was trained on: it had them, and held them not out.

    A run on the simulator's flights had those of its towns, and another dataset has the same ones,
    whatever its images and grid, where they were drawn alike (`DRAWN`).
    """
    known = {*(held := config.get("data", {})).get("val_clips", []), *held.get("test_clips", [])}
    own, scale = config.get("sim", {}), config.get("scale_name", "")

    if own_dataset != dataset:
        # The simulator's is called after the scale, a recording's or task=verge's otherwise.
        generated = re.fullmatch(f"{re.escape(scale)}-[0-9a-f]{{12}}", own_dataset)
        alike = all(own.get(key, off) == sim.get(key, off) for key, off in DRAWN.items())
        numbers = range(own.get("clips_per_town", 0))
        made = {f"{town}/clip{number:02d}" for town in own.get("towns", ()) for number in numbers}
        clips = [clip for clip in clips if generated and alike and clip in made]
    return [clip for clip in clips if clip not in known]


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


def hash_in_name(path: Path) -> str | None:
    """Returns the hash that a name ends in, by its first digits: torchvision's convention, and
    task=slim's."""
    in_name = re.search(r"-([0-9a-f]{8,64})\.(pth|ckpt)$", path.name)
    return in_name and in_name[1]


def _verify(path: Path, sha256: str | None) -> None:
    expected = sha256 or hash_in_name(path)
    actual = hashlib.sha256(path.read_bytes()).hexdigest()

    if not expected:
        raise UserError(
            f"model.backbone.weights_sha256: {path.name} carries no hash in its name; set this to "
            f"{actual} if you trust the file"
        )
    if not actual.startswith(expected.lower()):
        raise UserError(
            f"model.backbone.weights: {path} has SHA-256 {actual}, not {expected}; fetch it "
            "again, or rename it if it is sound"
        )
