"""The file of a pretrained image encoder, and which flights it was trained on."""

import hashlib
import io
from pathlib import Path

import torch
from torch import nn

from ..atomic import replacing
from ..data.datamodule import SkyShieldData
from ..data.split import held_out_clips
from ..errors import UserError
from ..models.weights import ORIGIN, read_encoder


def write_encoder(folder: Path, backbone: nn.Module, data: SkyShieldData) -> Path:
    """Writes ``image_encoder-<hash>.pth``, which is named after its content as `models.weights`
    wants it. Beside the weights it holds the data set's name and the clips that were held out."""
    origin = {"dataset": data.root.name, "held_out": held_out_clips(data.split)}
    content = io.BytesIO()  # given a path, torch.save writes its name into the file
    torch.save({"state_dict": backbone.state_dict(), ORIGIN: origin}, content)
    digest = hashlib.sha256(content.getvalue()).hexdigest()
    path = folder / f"image_encoder-{digest[:8]}.pth"
    with replacing(path) as temporary:
        temporary.write_bytes(content.getvalue())
    return path


def require_unseen(weights: str | None, data: SkyShieldData) -> None:
    """Raises `UserError` where an encoder of `write_encoder` was trained on a clip that is held out
    for the test: it has learnt its labels; and where one of our own does not say what it has seen.

    Of a published file nothing is known. Clips of another data set are other flights, whatever
    their names.
    """
    path = Path(weights or "")
    if not path.is_file():
        return
    _, origin = read_encoder(path)
    if not origin and path.name.startswith("image_encoder"):
        raise UserError(
            f"model.backbone.weights: {path} does not say which flights it was trained on, as "
            "files of task=pretrain do now; run task=pretrain again"
        )
    if not origin or origin["dataset"] != data.root.name:
        return

    known = {*origin["held_out"]["val"], *origin["held_out"]["test"]}
    seen = [clip for clip in held_out_clips(data.split)["test"] if clip not in known]
    if seen:
        raise UserError(
            f"model.backbone.weights: {weights} was trained on {seen[0]}, which this run holds out "
            f"for its test ({len(seen)} such clips); run task=pretrain with the same split"
        )
