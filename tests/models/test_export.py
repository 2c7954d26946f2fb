"""Exported graphs in the place of the model that they came from."""

import json
from functools import cache

import pytest
import torch

from src.errors import UserError
from src.models.export import DESCRIPTION, FORMATS, ExportedStep, export_step, require_formats
from src.models.ground import above_ground
from src.models.stream import SkyOccStream
from src.parallax import Parallax
from tests.models.synthetic import build_network
from tests.models.test_stream import GRID, HISTORY_STEP_S, frame_of

VOLUME = above_ground(GRID, -2, 14)
FACTS = {"name": "test", "history_step_s": HISTORY_STEP_S}


@pytest.fixture(scope="module")
def exported(tmp_path_factory, clips):
    """A network and the folder of its graphs, which are traced on the last of nine frames."""

    @cache
    def made(**options):
        network, folder = build_network(grid=GRID, **options), tmp_path_factory.mktemp("export")
        arguments = SkyOccStream(network, HISTORY_STEP_S).arguments(frame_of(clips, "town/a", 8))
        export_step(network, *arguments, folder, list(FORMATS), FACTS)
        return network, folder

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"history": "recursive", "volume": VOLUME, "lift": "lss"},
        {"volume": VOLUME, "parallax": Parallax([0.2, 0.4], bins=12)},
    ],
    ids=["plain", "another_history_volume_and_lift", "parallax"],
)
def test_graphs_give_what_the_model_gives(exported, clips, options):
    """Frames with no history, some, all of it, and none again after a gap."""
    network, folder = exported(**options)
    graphs = [ExportedStep(folder, name) for name in FORMATS]
    streams = [SkyOccStream(each, HISTORY_STEP_S) for each in (network, *graphs)]
    for number in (0, 1, 2, 3, 4, 5, 6, 7, 8, 15, 17):
        frame = frame_of(clips, "town/a", number)
        logits, *of_graphs = (stream(frame) for stream in streams)
        for each in of_graphs:
            torch.testing.assert_close(each, logits, atol=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_the_description_names_every_input_with_its_shape(exported):
    facts = json.loads((exported()[1] / DESCRIPTION).read_text())
    shapes = {entry["name"]: (entry["dtype"], entry["shape"]) for entry in facts["inputs"]}
    assert shapes["image"] == ("uint8", [1, 3, 64, 96])
    assert shapes["past_pillars"] == ("float32", [1, 3, 625, 16])
    assert shapes["past_valid"] == ("bool", [1, 3])
    assert facts["outputs"] == ["logits", "pillars"]
    assert (facts["name"], facts["history"]) == ("test", "queue")


@pytest.mark.slow
def test_another_image_size_or_history_step_than_the_graphs_is_refused(exported, clips):
    step, frame = ExportedStep(exported()[1], "onnx"), frame_of(clips, "town/a", 0)
    with pytest.raises(UserError, match=r"^image: 64x64, .* 96x64"):
        SkyOccStream(step, HISTORY_STEP_S)(frame._replace(image=frame.image[:, :, :64]))
    with pytest.raises(UserError, match=r"^history_step_s: 0\.3; .* 0\.4"):
        SkyOccStream(step, 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_or_broken_file_is_refused(exported, tmp_path, name):
    with pytest.raises(UserError, match=rf"{FORMATS[name]}: .*task=export"):
        ExportedStep(tmp_path, name)
    (tmp_path / DESCRIPTION).write_bytes((exported()[1] / DESCRIPTION).read_bytes())
    whole = (exported()[1] / FORMATS[name]).read_bytes()
    (tmp_path / FORMATS[name]).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match=rf"{FORMATS[name]}: .*export it again"):
        ExportedStep(tmp_path, name)


@pytest.mark.parametrize("formats", [["onnx", "tflite"], ["tensorrt"], []])
def test_formats_that_there_are_not_are_refused(formats):
    with pytest.raises(UserError, match=rf"task\.formats: .*{''.join(formats[-1:])}"):
        require_formats(formats)
