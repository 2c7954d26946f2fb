"""One step of a stream as a graph of tensors: exported, and run again without this code."""

import json
import logging
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ..atomic import replacing
from ..errors import UserError, import_extra, reason_of
from ..limits import require_choice
from ..parallax import Parallax
from .history import History
from .network import SkyOcc

# File names by format: ONNX, and torch.export.
FORMATS = {"onnx": "skyocc.onnx", "torch": "skyocc.pt2"}
DESCRIPTION = "export.json"

CAMERA = ("image", "pix_from_camera", "body_from_camera", "occ_from_body")
MEASURED = ("attitude_rad", "velocity_mps", "height_m")
CURRENT = CAMERA + MEASURED
# A graph has this input only where the network compares frames.
VOLUME = "parallax"
# A batch has these for every frame of a queue, and a step for the current one.
OF_QUEUE = ("image", "pix_from_camera", "occ_from_body")
# A graph has these inputs only where there is a history. Each has a batch dimension of 1.
PAST = ("past_pillars", "occ_from_past_occ", "past_valid")
OUTPUTS = ("logits", "pillars")

Run = Callable[[tuple[Tensor, ...]], tuple[Tensor, Tensor]]


class StepGraph(nn.Module):
    """`SkyOcc.step` of one frame with its tensors as arguments, in the order of ``names``."""

    def __init__(self, network: SkyOcc, names: Sequence[str]) -> None:
        super().__init__()
        self.network, self.names = network, [*names]

    def forward(self, *inputs: Tensor) -> tuple[Float[Tensor, "1 9 x y z"], Float[Tensor, "1 p d"]]:
        named = dict(zip(self.names, inputs))
        past = [named.pop(name) for name in PAST if name in named]
        batch = {name: x[:, None] if name in OF_QUEUE else x for name, x in named.items()}
        return self.network.step(batch, History(*past) if past else None)[:2]


def step_inputs(batch: Mapping[str, Tensor], history: History | None) -> dict[str, Tensor]:
    """Returns the arguments of a `StepGraph` by their names, from those of `SkyOcc.step`."""
    current = {name: batch[name] for name in (*CURRENT, VOLUME) if name in batch}
    inputs = {name: x[:, -1] if name in OF_QUEUE else x for name, x in current.items()}
    inputs |= dict(zip(PAST, history or ()))
    return {name: tensor.contiguous() for name, tensor in inputs.items()}


def export_step(
    network: SkyOcc,
    batch: Mapping[str, Tensor],
    history: History | None,
    folder: Path,
    formats: Sequence[str],
    facts: Mapping[str, Any],
) -> None:
    """Writes the graph of a step in every format, and a description of it, into a folder.

    ``batch`` and ``history`` may be of any frame: the graph takes their shapes. ``facts`` go into
    the description. Raises `UserError` where a format's packages are missing; ask `require_formats`
    whether there are such formats.
    """
    inputs = step_inputs(batch, history)
    # The exporter names packages that nobody needs.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        graph = StepGraph(network.eval(), [*inputs])
        program = torch.export.export(graph, tuple(inputs.values()))
        for name in formats:
            with replacing(folder / FORMATS[name]) as temporary:
                _write[name](program, [*inputs], temporary)

    described = [
        {"name": name, "dtype": str(tensor.dtype).removeprefix("torch."), "shape": [*tensor.shape]}
        for name, tensor in inputs.items()
    ]
    with replacing(folder / DESCRIPTION) as temporary:
        settings = network.parallax and network.parallax.settings
        of_network = {"history": network.history, "heights_m": network.heights_m, VOLUME: settings}
        facts = {**of_network, **facts, "inputs": described, "outputs": OUTPUTS}
        temporary.write_text(json.dumps(facts, indent=1) + "\n")


def require_formats(formats: Sequence[str]) -> None:
    """Raises `UserError` for an unknown format, and where no format is given."""
    for name in formats:
        require_choice("task.formats", name, FORMATS)
    if not formats:
        raise UserError(f"task.formats: empty; give some of {', '.join(FORMATS)}")


def _write_onnx(program: torch.export.ExportedProgram, inputs: Sequence[str], path: Path) -> None:
    import_extra("onnxscript", "export", "task.formats")
    names = {"input_names": inputs, "output_names": OUTPUTS}
    graph = torch.onnx.export(program, dynamo=True, verbose=False, **names)
    graph.save(str(path))


def _write_torch(program: torch.export.ExportedProgram, _inputs: Sequence[str], path: Path) -> None:
    with path.open("wb") as file:
        torch.export.save(program, file)


_write = {"onnx": _write_onnx, "torch": _write_torch}


class ExportedStep:
    """A graph that `export_step` wrote, which stands in for its network in a `SkyOccStream`.

    ``format`` is one of `FORMATS`. Raises `UserError` for another one, for a folder without the
    graph, an unreadable file, or missing packages.
    """

    def __init__(self, folder: Path, format: str, threads: int = 0) -> None:
        require_formats([format])
        path, description = folder / FORMATS[format], folder / DESCRIPTION
        if not path.is_file() or not description.is_file():
            raise UserError(f"{path}: no exported graph; make it with task=export")

        facts = json.loads(description.read_text())
        shapes = {entry["name"]: entry["shape"] for entry in facts["inputs"]}
        _, self.past_frames, *self.pillar_shape = shapes.get("past_pillars", [1, 0, 0, 0])
        self.device = torch.device("cpu")
        self.history_step_s = facts.get("history_step_s")
        self.heights_m = facts.get("heights_m")
        self.parallax = Parallax(**facts[VOLUME]) if facts.get(VOLUME) else None
        self.image_shape = shapes["image"]

        try:
            self.run: Run = _open[format](path, threads)
        except UserError:
            raise
        except Exception as error:  # of many kinds, which have no class in common
            raise UserError(
                f"{path}: cannot be read ({reason_of(error)}); export it again"
            ) from error

    def eval(self) -> "ExportedStep":
        """Returns itself: a graph never trains."""
        return self

    def step(self, batch: Mapping[str, Tensor], history: History | None) -> tuple[Tensor, Tensor]:
        """Computes `SkyOcc.step`. Raises `UserError` for an image of another size."""
        image = batch["image"][:, -1]
        if [*image.shape] != self.image_shape:
            height, width = image.shape[-2:]
            raise UserError(
                f"image: {width}x{height}, and the graph is for {self.image_shape[3]}x"
                f"{self.image_shape[2]}; export it again for this camera"
            )
        return self.run(tuple(step_inputs(batch, history).values()))


def _open_onnx(path: Path, threads: int) -> Run:
    onnxruntime = import_extra("onnxruntime", "export", str(path))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    names = [entry.name for entry in session.get_inputs()]

    def run(inputs: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
        arrays = {name: tensor.numpy() for name, tensor in zip(names, inputs)}
        return tuple(map(torch.from_numpy, session.run(list(OUTPUTS), arrays)))

    return run


def _open_torch(path: Path, threads: int) -> Run:
    module = torch.export.load(path).module()
    return lambda inputs: module(*inputs)


_open = {"onnx": _open_onnx, "torch": _open_torch}
