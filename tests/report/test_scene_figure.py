"""What the page shows of frames: the image, volumes of one scale, one legend, and few bytes."""

import dataclasses

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.ontology import CAR, FREE, UNKNOWN
from src.report.scene import TRUTH
from src.report.scene_figure import scenes_figure
from tests.report.street import GRID, SMALL, scene_of, street

VIEWS = ("scene", "scene2", "scene3")


@pytest.fixture(scope="module")
def scene():
    return scene_of(SMALL)


@pytest.fixture(scope="module")
def figure(scene):
    """Two scenes."""
    return scenes_figure([scene, dataclasses.replace(scene, title="second <b>")])


def of_kind(figure, kind):
    return [trace for trace in figure.data if trace.type == kind and trace.visible]


def test_the_ground_truth_stands_beside_the_image_and_every_prediction(figure):
    titles = [note.text for note in figure.layout.annotations]
    assert titles == ["RGB", TRUTH, "baseline", "skyocc"]
    meshes = of_kind(figure, "mesh3d")
    assert {mesh.scene for mesh in meshes} == {*VIEWS}
    (image,) = of_kind(figure, "image")
    assert image.source.startswith("data:image/jpeg;base64,")
    # A class has one entry in the legend, which hides it everywhere.
    named = [mesh.name for mesh in meshes if mesh.showlegend]
    assert len(named) == len({*named}) == len({mesh.name for mesh in meshes})
    assert all(mesh.legendgroup == mesh.name for mesh in meshes)


def test_all_volumes_have_the_same_ranges(figure):
    for view in (figure.layout[name] for name in VIEWS):
        axes = (view.xaxis, view.yaxis, view.zaxis)
        assert [axis.range for axis in axes] == [(0, 50), (-25, 25), (-20, 8)]
        ratio = [view.aspectratio[name] for name in "xyz"]
        assert ratio == pytest.approx([1.5, 1.5, 1.5 * 28 / 50])
        assert view.camera == figure.layout.scene.camera


def test_the_list_shows_one_scene_at_a_time_and_the_buttons_turn_all_volumes(figure):
    scenes, cameras = figure.layout.updatemenus
    first, second = (button.args[0]["visible"] for button in scenes.buttons)
    assert [trace.visible for trace in figure.data] == first
    assert second == [not shown for shown in first]
    assert [trace.type for trace, shown in zip(figure.data, second) if shown].count("image") == 1
    assert scenes.buttons[1].label == "2 of 2: second &lt;b&gt;"
    assert [button.label for button in cameras.buttons] == ["Behind", "Above"]
    turned = {f"{view}.camera" for view in VIEWS}
    assert all(button.args[0].keys() == turned for button in cameras.buttons)


def test_predictions_show_the_space_of_the_labels(scene):
    junk = np.where(scene.truth == UNKNOWN, np.uint8(CAR), scene.truth)
    meshes = of_kind(scenes_figure([scene_of(SMALL, predictions={"junk": junk})]), "mesh3d")
    truth, shown = ({m.name: len(m.i) for m in meshes if m.scene == view} for view in VIEWS[:2])
    assert truth == shown
    assert (scene.known()["skyocc"] == UNKNOWN).sum() == (scene.truth == UNKNOWN).sum() > 0


def test_the_lines_are_the_plumb_line_and_if_there_is_a_camera_the_frustum(scene):
    plumb, frustum = of_kind(scenes_figure([scene_of(SMALL, predictions={})]), "scatter3d")
    assert plumb.z == (-12, 0)
    drawn = np.unique(np.stack([frustum[axis] for axis in "xyz"], axis=-1).round(6), axis=0)
    corners = torch.cat([scene.frustum.corners(0.0)[:1], scene.frustum.corners(0.16 * 50)])
    assert np.allclose(drawn, np.unique(corners.numpy().round(6), axis=0))

    empty = np.full(SMALL.shape, FREE, np.uint8)
    figure = scenes_figure([scene_of(SMALL, truth=empty, predictions={}, frustum=None)])
    assert [trace.type for trace in figure.data] == ["image", "scatter3d"]
    assert figure.data[1].z == (0, 0)


@pytest.mark.parametrize("name", ["baseline", TRUTH])
def test_labels_of_another_grid_and_a_name_that_is_taken_are_refused(name):
    labels = street(GRID if name == "baseline" else SMALL)
    with pytest.raises(UserError, match=r"grid\.shape|rename"):
        scene_of(SMALL, predictions={name: labels})


def test_a_scene_of_three_volumes_is_well_below_three_megabytes():
    assert len(scenes_figure([scene_of(GRID)]).to_json()) < 1_500_000
