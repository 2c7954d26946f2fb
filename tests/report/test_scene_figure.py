"""What the page shows of frames: the image, volumes of one scale, one legend, and few bytes."""

import numpy as np
import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.ontology import CAR, FREE, UNKNOWN
from src.report.scene import TRUTH, VoxelScene
from src.report.scene_figure import scenes_figure
from tests.report.street import GRID, HEIGHT, WIDTH, street, tilted_frustum

SMALL = VoxelGrid(shape=(25, 25, 15))


def scene_of(grid, **changes):
    """A street, its labels seen by a tilted camera, and two predictions that err differently."""
    frustum = tilted_frustum(0.2, 0.1)
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    shifted = np.roll(street(grid), 2, axis=1)
    noisy = street(grid)
    noisy[np.random.default_rng(1).random(grid.shape) < 0.01] = CAR
    scene = {
        "title": "downtown-03 frame 41",
        "grid": grid,
        "image": image,
        "truth": street(grid, frustum),
        "predictions": {"baseline": shifted, "skyocc": noisy},
        "frustum": frustum,
    }
    return VoxelScene(**{**scene, **changes})


def of_kind(figure, kind):
    return [trace for trace in figure.data if trace.type == kind]


def sizes(figure, view):
    """The number of triangles of each class in one view."""
    meshes = of_kind(figure, "mesh3d")
    return {mesh.name: len(mesh.i) for mesh in meshes if (mesh.scene or "scene") == view}


def test_the_ground_truth_stands_beside_the_image_and_every_prediction():
    figure = scenes_figure([scene_of(SMALL)])
    titles = [note.text for note in figure.layout.annotations]
    assert titles == ["RGB", TRUTH, "baseline", "skyocc"]
    assert {mesh.scene for mesh in of_kind(figure, "mesh3d")} == {"scene", "scene2", "scene3"}
    (image,) = of_kind(figure, "image")
    assert image.source.startswith("data:image/jpeg;base64,")


def test_all_volumes_have_the_same_ranges():
    shifted = scene_of(SMALL).predictions["baseline"]
    layout = scenes_figure([scene_of(SMALL, predictions={"a": shifted, "b": shifted})]).layout
    for view in (layout.scene, layout.scene2, layout.scene3):
        axes = (view.xaxis, view.yaxis, view.zaxis)
        assert [axis.range for axis in axes] == [(0, 50), (-25, 25), (-12, 6)]
        ratio = [view.aspectratio[name] for name in "xyz"]
        assert ratio == pytest.approx([1.5, 1.5, 1.5 * 18 / 50])
        assert view.camera == layout.scene.camera


def test_predictions_show_the_space_of_the_labels():
    scene = scene_of(SMALL)
    junk = np.where(scene.truth == UNKNOWN, np.uint8(CAR), scene.truth)
    figure = scenes_figure([scene_of(SMALL, predictions={"junk": junk})])
    assert sizes(figure, "scene2") == sizes(figure, "scene")
    shown = scene.known()["skyocc"]
    assert (shown == UNKNOWN).sum() == (scene.truth == UNKNOWN).sum() > 0


def test_the_list_shows_one_scene_at_a_time_and_the_buttons_turn_all_volumes():
    figure = scenes_figure([scene_of(SMALL), scene_of(SMALL, title="second <b>")])
    scenes, cameras = figure.layout.updatemenus
    first, second = (button.args[0]["visible"] for button in scenes.buttons)
    assert [trace.visible for trace in figure.data] == first
    assert second == [not shown for shown in first]
    assert [trace.type for trace, shown in zip(figure.data, second) if shown].count("image") == 1
    assert scenes.buttons[1].label == "2 of 2: second &lt;b&gt;"
    views = {f"{view}.camera" for view in ("scene", "scene2", "scene3")}
    assert [button.label for button in cameras.buttons] == ["Behind", "Above"]
    assert all(button.args[0].keys() == views for button in cameras.buttons)


def test_a_class_has_one_entry_in_the_legend_which_hides_it_everywhere():
    meshes = of_kind(scenes_figure([scene_of(SMALL)]), "mesh3d")
    named = [mesh.name for mesh in meshes if mesh.showlegend]
    assert len(named) == len(set(named)) == len({mesh.name for mesh in meshes})
    assert all(mesh.legendgroup == mesh.name for mesh in meshes)


def test_the_lines_are_the_plumb_line_and_if_there_is_a_camera_the_frustum():
    scene = scene_of(SMALL, predictions={})
    plumb, frustum = of_kind(scenes_figure([scene]), "scatter3d")
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
