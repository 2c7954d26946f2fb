"""Exported graphs in the place of the model that they came from."""

import json

import pytest
import torch

from src.errors import UserError
from src.models.export import DESCRIPTION, FORMATS, ExportedStep, export_step, require_formats
from src.models.ground import above_ground
from src.models.stream import SkyOccStream
from tests.models.synthetic import build_network
from tests.models.test_stream import GRID, HISTORY_STEP_S, frame_of

VOLUME = above_ground(GRID, -2, 14)
FACTS = {"name": "test", "history_step_s": HISTORY_STEP_S}


def exported(folder, clips, formats, **network):
    """A network and the folder of its graphs, which are traced on the last of nine frames."""
    network = build_network(grid=GRID, **network)
    stream = SkyOccStream(network, HISTORY_STEP_S)
    arguments = stream.arguments(frame_of(clips, "town/a", 8))
    export_step(network, *arguments, folder, formats, FACTS)
    return network, folder


@pytest.fixture(scope="module")
def both(tmp_path_factory, clips):
    return exported(tmp_path_factory.mktemp("export"), clips, list(FORMATS))


def require_same_stream(network, graph, clips):
    """Frames with no history, some, all of it, and none again after a gap."""
    streams = [SkyOccStream(each, HISTORY_STEP_S) for each in (network, graph)]
    for number in (0, 1, 2, 3, 4, 5, 6, 7, 8, 15, 17):
        logits, exported = (stream(frame_of(clips, "town/a", number)) for stream in streams)
        torch.testing.assert_close(exported, logits, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_a_graph_gives_what_the_model_gives(both, clips, name):
    network, folder = both
    require_same_stream(network, ExportedStep(folder, name), clips)


@pytest.mark.slow
def test_the_description_names_every_input_with_its_shape(both):
    facts = json.loads((both[1] / DESCRIPTION).read_text())
    shapes = {entry["name"]: (entry["dtype"], entry["shape"]) for entry in facts["inputs"]}
    assert shapes["image"] == ("uint8", [1, 3, 64, 96])
    assert shapes["past_pillars"] == ("float32", [1, 3, 625, 16])
    assert shapes["past_valid"] == ("bool", [1, 3])
    assert facts["outputs"] == ["logits", "pillars"]
    assert (facts["name"], facts["history"]) == ("test", "queue")


@pytest.mark.slow
def test_another_history_volume_and_lift_export_too(tmp_path, clips):
    options = {"history": "recursive", "volume": VOLUME, "lift": "lss"}
    network, folder = exported(tmp_path, clips, list(FORMATS), **options)
    for name in FORMATS:
        require_same_stream(network, ExportedStep(folder, name), clips)


@pytest.mark.slow
def test_another_image_size_or_history_step_than_the_graphs_is_refused(both, clips):
    step, frame = ExportedStep(both[1], "onnx"), frame_of(clips, "town/a", 0)
    with pytest.raises(UserError, match=r"^image: 64x64, .* 96x64"):
        SkyOccStream(step, HISTORY_STEP_S)(frame._replace(image=frame.image[:, :, :64]))
    with pytest.raises(UserError, match=r"^history_step_s: 0\.3; .* 0\.4"):
        SkyOccStream(step, 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_or_broken_file_is_refused(both, tmp_path, name):
    with pytest.raises(UserError, match=rf"{FORMATS[name]}: .*task=export"):
        ExportedStep(tmp_path, name)
    (tmp_path / DESCRIPTION).write_bytes((both[1] / DESCRIPTION).read_bytes())
    whole = (both[1] / FORMATS[name]).read_bytes()
    (tmp_path / FORMATS[name]).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match=rf"{FORMATS[name]}: .*export it again"):
        ExportedStep(tmp_path, name)


@pytest.mark.parametrize("formats", [["onnx", "tflite"], ["tensorrt"], []])
def test_formats_that_there_are_not_are_refused(formats):
    with pytest.raises(UserError, match=rf"task\.formats: .*{''.join(formats[-1:])}"):
        require_formats(formats)
