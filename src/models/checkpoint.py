"""Checkpoint files: written whole or not at all, and each enough to run its network."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from jaxtyping import UInt8
from lightning.fabric.plugins import TorchCheckpointIO
from omegaconf import OmegaConf
from torch import Tensor, nn

from ..atomic import replacing
from ..dotted import replaced
from ..errors import UserError, reason_of, way_out_of
from ..geometry import VoxelGrid
from .calibrator import Calibrator
from .network import SkyOcc
from .weights import ORIGIN, UNREADABLE, hash_in_name

# Format of a checkpoint's own part. Files of format 1 held weights and no configuration, those of
# format 2 no prior by height.
FORMAT = 3


class WholeCheckpoints(TorchCheckpointIO):
    """Writes a checkpoint beside its place and renames it.

    Lightning writes it in the system's folder for temporary files. Where that is another disk, the
    move is a copy, and a run that is killed meanwhile has no last checkpoint any more.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Raises `UserError` where it cannot be written."""
        with replacing(path) as temporary:
            torch.save(checkpoint, temporary)


@dataclass(frozen=True)
class Origin:
    """The origin of a checkpoint's weights: all that loading needs beside them.

    ``config`` is the composed configuration without places and what shapes nothing. ``code`` is the
    digest of each file that shaped the run, ``dataset`` the dataset's name. ``class_counts`` [9]
    are the voxels of each class in the training labels. ``voxel_prior`` and ``height_prior`` are
    what these predict where nobody looks (`VoxelPrior`), the second from ``lowest_layer`` upwards.
    ``backbone`` holds arguments of the image encoder that replace those in ``config``: with them it
    is built without the files that its training began with. ``calibration`` holds the arguments of
    a `Calibrator`, once task=calibrate has fitted one.
    """

    config: dict
    code: dict[str, str]
    dataset: str
    class_counts: list[int]
    voxel_prior: UInt8[Tensor, "X Y Z"]
    height_prior: UInt8[Tensor, "X Y K"]
    lowest_layer: int
    backbone: dict = field(default_factory=dict)
    calibration: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Checkpoint:
    """A trained network in a file: its weights, where they come from, and the epochs done."""

    path: Path
    state: dict[str, Tensor]
    origin: Origin
    epochs: int

    @classmethod
    def read(cls, path: str | Path) -> "Checkpoint":
        """Reads a file. Raises `UserError` where it is missing, damaged, or of another format."""
        content = read_content(Path(path))
        facts = dict(content.get(ORIGIN, {}))
        if (written := facts.pop("format", 1)) != FORMAT:
            raise UserError(
                f"ckpt_path: {path} is of format {written}, and this code reads format {FORMAT}, "
                "with configuration and priors in it; train again, or use the code that wrote it"
            )

        # Facts with a default are those that a file need not have.
        optional = {"backbone", "calibration"}
        if wrong := {each.name for each in fields(Origin)} ^ {*optional, *facts}:
            raise UserError(
                f"ckpt_path: {path} does not hold what format {FORMAT} has, but lacks or adds "
                f"{', '.join(sorted(wrong))}; use the code that wrote it, or train again"
            )
        return cls(Path(path), content["state_dict"], Origin(**facts), content["epoch"] + 1)

    def network(self, calibrated: bool = False) -> SkyOcc:
        """Returns the network, in evaluation. Needs no dataset, and no file but this one.

        Raises `UserError` where a class that the configuration names is gone or has changed, and
        where it shall be ``calibrated`` and the file holds no calibration.
        """
        if calibrated and not self.origin.calibration:
            raise UserError(
                f"calibrated: {self.path} holds no calibration; run task=calibrate, which writes a "
                "checkpoint that does"
            )
        # Without the files that the training began with: what became of them is in this one.
        model = self.origin.config["model"]
        model = {**model, "backbone": {**model["backbone"], **self.origin.backbone}}

        try:
            network = instantiate(OmegaConf.create(replaced(model, _of_this_package)))
        except InstantiationException as error:
            reason = " ".join(str(error.__cause__ or error).split())
            raise UserError(
                f"ckpt_path: {self.path} holds a model that cannot be built ({reason}); use the "
                "code that wrote it"
            ) from error

        load_weights(nn.ModuleDict({"network": network}), self.state, self.path)
        if calibrated:
            grid = VoxelGrid(**self.origin.config["grid"])
            network.calibrator = Calibrator.of(grid, self.origin.calibration)
        return network.eval()


def _of_this_package(name: Any) -> Any:
    """Returns the name of a class of ``src`` as this package has it here: other projects import it
    as ``skyshield``, and may have a ``src`` of their own."""
    own = __name__.partition(".")[0]
    return f"{own}.{name[4:]}" if isinstance(name, str) and name.startswith("src.") else name


def read_content(path: Path) -> dict[str, Any]:
    """Reads all that Lightning wrote. Raises `UserError` for a file that is no checkpoint, or not
    the one of the hash in its name."""
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        if {"state_dict", "epoch"} - content.keys():
            raise KeyError("it holds no training")
    except FileNotFoundError:
        raise UserError(
            f"ckpt_path: no checkpoint {path}; give best, last or an existing file"
        ) from None
    except UNREADABLE as error:
        way_out = way_out_of(error, "give another one, or move it away to start anew", path)
        raise UserError(
            f"ckpt_path: {path} is no readable checkpoint ({reason_of(error)}); {way_out}"
        ) from error

    said = hash_in_name(path)
    if said and not sha256(path.read_bytes()).hexdigest().startswith(said):
        raise UserError(
            f"ckpt_path: {path} has another hash than its name ends in; fetch it again, or rename "
            f"it, where {said} is no hash but a date"
        )
    return content


def load_weights(module: nn.Module, state: Mapping[str, Tensor], path: Path) -> None:
    """Fills a module from the weights of a checkpoint, which is named in the error.

    Raises `UserError` for weights of another architecture.
    """
    own, saved = (
        {(name, tensor.shape) for name, tensor in each.items()}
        for each in (module.state_dict(), state)
    )

    # A name appears here once for each shape that only one of the two has.
    if different := sorted({name for name, _ in own ^ saved}):
        raise UserError(
            f"ckpt_path: {path} is of another architecture ({len(different)} parameters differ, "
            f"{different[0]} first); use the model and scale that it was trained with"
        )
    module.load_state_dict(state)
