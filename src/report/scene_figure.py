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
from .canvas import address, encoded
from .scene import VoxelScene
from .view import FRUSTUM_SHARE
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
    # The image has no depth, and where nothing is shown there is no plot.
    kinds = [{"type": "xy"}, *({"type": "scene"} for _ in titles[1:])]
    kinds += [None] * (rows * COLUMNS - len(kinds))
    specs = [kinds[COLUMNS * row : COLUMNS * (row + 1)] for row in range(rows)]
    gaps = {"horizontal_spacing": 0.02, "vertical_spacing": 0.04}
    figure = make_subplots(rows, COLUMNS, specs=specs, subplot_titles=titles, **gaps)

    heights_m, shown = _heights_m(scenes), []
    for number, scene in enumerate(scenes):
        for place, traces in enumerate(_views(scene, heights_m[0])):
            row, column = divmod(place, COLUMNS)
            for trace in traces:
                figure.add_trace(trace.update(visible=number == 0), row + 1, column + 1)
                shown.append(number)

    views = [f"scene{n}" if n > 1 else "scene" for n in range(1, len(titles))]
    figure.update_layout(
        height=ROW_PIX * rows,
        margin={"l": 0, "r": 0, "t": 90, "b": 0},
        legend={"orientation": "h", "y": -0.02},
        updatemenus=_menus(scenes, shown, views),
        **dict.fromkeys(views, _axes(scenes[0].grid, heights_m)),
    )
    return figure.update_xaxes(visible=False).update_yaxes(visible=False)


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
    lines = {UAV_COLOR: [(0, 0, floor_m), (0, 0, 0)]}
    if scene.frustum is not None:
        depth_m = FRUSTUM_SHARE * (scene.grid.upper_m[0] - scene.grid.lower_m[0])
        lines[FRUSTUM_COLOR] = scene.frustum.outline(depth_m)
    for color, points_m in lines.items():
        line = {"line": {"color": color, "width": 4}, "mode": "lines", "hoverinfo": "skip"}
        yield go.Scatter3d(**dict(zip("xyz", zip(*points_m))), showlegend=False, **line)


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


def _menus(
    scenes: Sequence[VoxelScene], shown: Sequence[int], views: Sequence[str]
) -> tuple[dict, dict]:
    """Returns the list of scenes and the buttons of the cameras; ``shown`` is the scene of every
    trace."""
    of_scenes = [
        {"label": escape(f"{n + 1} of {len(scenes)}: {scene.title}"), "method": "restyle"}
        | {"args": [{"visible": [of == n for of in shown]}]}
        for n, scene in enumerate(scenes)
    ]
    of_cameras = [
        {"label": name, "method": "relayout"}
        | {"args": [{f"{view}.camera": camera for view in views}]}
        for name, camera in CAMERAS.items()
    ]

    above = {"y": 1.05, "yanchor": "bottom"}
    return (
        {"buttons": of_scenes, "x": 0, "xanchor": "left", **above},
        {"buttons": of_cameras, "x": 1, "xanchor": "right", **above}
        | {"type": "buttons", "direction": "right"},
    )
