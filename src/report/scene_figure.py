"""Scenes as one figure of plotly: image, ground truth and predictions, one scene at a time."""

import math
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from PIL import Image
from plotly.subplots import make_subplots

from ..geometry import VoxelGrid
from ..ontology import FREE
from .overlay import FRUSTUM_SHARE
from .picture import address, encoded
from .scene import VoxelScene
from .voxel_mesh import voxel_meshes

# A browser draws 16 volumes on a page, and forgets the first ones for any more: so all scenes share
# one figure, in which a list chooses what is seen.
COLUMNS, ROW_PIX = 2, 440
IMAGE_QUALITY = 88
FRUSTUM_COLOR, UAV_COLOR = "#eb5e14", "#7b8794"
# Where the cameras of all volumes stand; the UAV's left is left in both.
CAMERAS = {
    "Behind": {"eye": {"x": -1.9, "y": 0, "z": 1.1}, "center": {"x": -0.05, "y": 0, "z": -0.2}},
    "Above": {"eye": {"x": -0.01, "y": 0, "z": 2}, "center": {"x": 0, "y": 0, "z": 0}},
}


def scenes_figure(scenes: Sequence[VoxelScene]) -> go.Figure:
    """Returns the figure. All scenes have one grid, and predictions of the same models.

    The legend hides a class in all volumes. Lines are the UAV's plumb line and its camera's
    frustum.
    """
    titles = ["RGB", *map(escape, scenes[0].volumes)]
    rows = math.ceil(len(titles) / COLUMNS)
    places = [divmod(place, COLUMNS) for place in range(len(titles))]
    # The image has no depth, and where nothing is shown there is no plot.
    kinds = [[{"type": "scene"} if at in places else None for at in row] for row in _cells(rows)]
    kinds[0][0] = {"type": "xy"}
    gaps = {"horizontal_spacing": 0.02, "vertical_spacing": 0.04}
    figure = make_subplots(rows, COLUMNS, specs=kinds, subplot_titles=titles, **gaps)

    heights_m, shown = _heights_m(scenes), []
    for number, scene in enumerate(scenes):
        for (row, column), traces in zip(places, _views(scene, heights_m[0])):
            for trace in traces:
                figure.add_trace(trace.update(visible=number == 0), row + 1, column + 1)
                shown.append(number)

    views = [f"scene{n}" if n > 1 else "scene" for n in range(1, len(titles))]
    figure.update_layout(
        height=ROW_PIX * rows,
        margin={"l": 0, "r": 0, "t": 90, "b": 0},
        legend={"orientation": "h", "y": -0.02},
        updatemenus=[_scene_menu(scenes, shown), _camera_buttons(views)],
        **dict.fromkeys(views, _axes(scenes[0].grid, heights_m)),
    )
    return figure.update_xaxes(visible=False).update_yaxes(visible=False)


def _cells(rows: int) -> list[list[tuple[int, int]]]:
    return [[(row, column) for column in range(COLUMNS)] for row in range(rows)]


def _heights_m(scenes: Sequence[VoxelScene]) -> tuple[float, float]:
    """Returns the ends of all voxels and of the UAV, at height 0: beyond them nothing is to see."""
    grid = scenes[0].grid
    occupied = [labels < FREE for scene in scenes for labels in scene.known().values()]
    layers = np.flatnonzero(np.any(occupied, axis=(0, 1, 2)))
    edges_m = grid.lower_m[2] + grid.voxel_m * np.append(layers, layers + 1)
    return float(edges_m.min(initial=0)), float(edges_m.max(initial=0))


def _views(scene: VoxelScene, floor_m: float) -> Iterator[list[go.Image | go.Mesh3d]]:
    """Yields the traces of the image and of each volume, where the ground truth is known."""
    image = encoded(Image.fromarray(scene.image), "JPEG", quality=IMAGE_QUALITY)
    yield [go.Image(source=address(image, "image/jpeg"), hoverinfo="skip")]

    named: set[str] = set()
    for labels in scene.known().values():
        meshes = voxel_meshes(labels, scene.grid)
        for mesh in meshes:
            # One entry of the legend stands for a class in all volumes.
            mesh.update(legendgroup=mesh.name, showlegend=mesh.name not in named)
            named.add(mesh.name)
        yield [*meshes, *_lines(scene, floor_m)]


def _lines(scene: VoxelScene, floor_m: float) -> Iterator[go.Scatter3d]:
    """Yields the UAV's plumb line and, if there is a camera, the edges of its frustum."""
    yield _line(UAV_COLOR, [(0, 0, floor_m), (0, 0, 0)])
    if scene.frustum is not None:
        lens = scene.frustum.corners(0.0).tolist()[0]
        depth_m = FRUSTUM_SHARE * (scene.grid.upper_m[0] - scene.grid.lower_m[0])
        corners = scene.frustum.corners(depth_m).tolist()
        spokes = [point for corner in corners for point in (lens, corner)]
        yield _line(FRUSTUM_COLOR, [*corners, *spokes, corners[0]])


def _line(color: str, points_m: Sequence[Sequence[float]]) -> go.Scatter3d:
    x, y, z = zip(*points_m)
    line = {"line": {"color": color, "width": 4}, "mode": "lines", "hoverinfo": "skip"}
    return go.Scatter3d(x=x, y=y, z=z, showlegend=False, **line)


def _axes(grid: VoxelGrid, heights_m: tuple[float, float]) -> dict:
    """Returns what all volumes share: with equal ranges, one camera shows one place in each."""
    ends_m = [*zip(grid.lower_m[:2], grid.upper_m[:2]), heights_m]
    sides_m = [high - low for low, high in ends_m]
    # The longer side of the ground is 1.5 units of plotly's cameras.
    ratio = [1.5 * side / max(sides_m[:2]) for side in sides_m]
    axes = {
        f"{name}axis": {"title": {"text": title}, "range": ends, "dtick": 10, "showspikes": False}
        for name, title, ends in zip("xyz", ("ahead (m)", "left (m)", "up (m)"), ends_m)
    }
    view = {"aspectratio": dict(zip("xyz", ratio)), "dragmode": "turntable"}
    return {**axes, **view, "camera": CAMERAS["Behind"]}


def _scene_menu(scenes: Sequence[VoxelScene], shown: Sequence[int]) -> dict:
    """Returns the list of scenes; ``shown`` is the scene of every trace."""
    buttons = [
        {
            "label": escape(f"{number + 1} of {len(scenes)}: {scene.title}"),
            "method": "restyle",
            "args": [{"visible": [of == number for of in shown]}],
        }
        for number, scene in enumerate(scenes)
    ]
    return {"buttons": buttons, "x": 0, "xanchor": "left", "y": 1.05, "yanchor": "bottom"}


def _camera_buttons(views: Sequence[str]) -> dict:
    buttons = [
        {
            "label": name,
            "method": "relayout",
            "args": [{f"{view}.camera": camera for view in views}],
        }
        for name, camera in CAMERAS.items()
    ]
    place = {"x": 1, "xanchor": "right", "y": 1.05, "yanchor": "bottom"}
    return {"type": "buttons", "direction": "right", "buttons": buttons, **place}
