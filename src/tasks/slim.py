"""task=slim: a trained network as a small file, to keep and to give away."""

import hashlib
import io
from pathlib import Path

import torch
from omegaconf import DictConfig

from ..atomic import replacing
from ..models.checkpoint import read_content
from ..models.weights import ORIGIN
from ..terminal import say
from .session import Session


def slim(cfg: DictConfig, out: str) -> Path:
    """Writes ``<out>/<experiment>-<scale>-<hash>.ckpt``: the checkpoint's weights in half precision
    and where they come from, without the optimizer.

    Like any checkpoint, ``ckpt_path`` takes it, and ``model.backbone.weights`` its image encoder.
    The hash is of the content. Raises `UserError` as `Session.checkpoint` does.
    """
    content = read_content(Session(cfg).checkpoint("slim").path)
    kept = {key: content[key] for key in ("epoch", ORIGIN)}
    kept["state_dict"] = {
        name: each.half() if each.is_floating_point() else each
        for name, each in content["state_dict"].items()
    }

    written = io.BytesIO()  # given a path, torch.save writes its name into the file
    torch.save(kept, written)
    digest = hashlib.sha256(written.getvalue()).hexdigest()
    slimmed = Path(out) / f"{cfg.name}-{cfg.scale_name}-{digest[:8]}.ckpt"
    with replacing(slimmed) as temporary:
        temporary.write_bytes(written.getvalue())
    say(f"{slimmed}: {slimmed.stat().st_size / 1e6:.1f} MB")
    return slimmed
