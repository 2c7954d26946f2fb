"""The file of a pretrained image encoder, and which flights it was trained on."""

import hashlib
import io
import json
from pathlib import Path

import torch
from torch import nn

from ..atomic import replacing
from ..data.datamodule import SkyShieldData
from ..data.split import held_out_clips
from ..errors import UserError

NAME = "image_encoder"


def write_encoder(folder: Path, backbone: nn.Module, data: SkyShieldData) -> Path:
    """Writes ``image_encoder-<hash>.pth``, which is named after its content as `models.weights`
    wants it, and beside it, as JSON, the data set and the clips that were held out."""
    content = io.BytesIO()  # given a path, torch.save writes its name into the file
    torch.save(backbone.state_dict(), content)
    digest = hashlib.sha256(content.getvalue()).hexdigest()
    path = folder / f"{NAME}-{digest[:8]}.pth"
    facts = {"dataset": data.root.name, "held_out": held_out_clips(data.split)}
    with replacing(path.with_suffix(".json")) as temporary:
        temporary.write_text(json.dumps(facts, indent=1) + "\n")
    with replacing(path) as temporary:
        temporary.write_bytes(content.getvalue())
    return path


def require_unseen(weights: str | None, data: SkyShieldData) -> None:
    """Raises `UserError` where an encoder of `write_encoder` was trained on a clip that is held out
    for the test: it has learnt its labels.

    Of a file without facts beside it, as a published one, nothing is known. Clips of another data
    set are other flights, whatever their names.
    """
    beside = Path(weights).with_suffix(".json") if weights else None
    if beside is None or not beside.is_file():
        return
    try:
        facts = json.loads(beside.read_text())
        dataset, held_out = facts["dataset"], facts["held_out"]
        known = {*held_out["val"], *held_out["test"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{beside}: cannot be read ({error}); run task=pretrain again") from None
    seen = [clip for clip in held_out_clips(data.split)["test"] if clip not in known]
    if dataset == data.root.name and seen:
        raise UserError(
            f"model.backbone.weights: {weights} was trained on {seen[0]}, which this run holds out "
            f"for its test ({len(seen)} such clips); run task=pretrain with the same split"
        )
