"""The bullet client: what it draws, and what it leaves behind."""

import tracemalloc
from types import SimpleNamespace

import numpy as np

from src.sim.drawing import Drawing
from src.sim.mesh import Mesh


def test_a_closed_drawing_keeps_nothing_of_its_meshes():
    """pybullet itself keeps every list of vertices, about 150 bytes a row."""
    rng = np.random.default_rng(0)
    vertices_m, uvs = rng.random((3000, 3)), rng.random((3000, 2))
    mesh = Mesh(vertices_m, vertices_m, uvs, np.arange(3000).reshape(-1, 3))

    def draw():
        drawing = Drawing("tiny")
        drawing.add(mesh, uvs, "bark")
        drawing.close()

    tracemalloc.start()
    try:
        draw()
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(3):
            draw()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 3 * 3000 * 10


def test_a_build_without_numpy_draws_the_same_picture(monkeypatch):
    """It gives flat tuples of Python's numbers, one with numpy arrays."""
    corners_m = np.array([[9.0, -4, -4], [9, 4, -4], [9, 0, 4]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    drawing = Drawing("tiny")
    draw = drawing._bullet.getCameraImage
    try:
        drawing.add(
            Mesh(corners_m, up, up[:, :2], np.array([[0, 2, 1], [0, 1, 2]])), up[:, :2], "bark"
        )
        view = drawing._bullet.computeViewMatrix([0, 0, 0], [1, 0, 0], [0, 0, 1])
        frustum = drawing._bullet.computeProjectionMatrixFOV(90, 1.5, 0.1, 50)
        light = {"lightDirection": [0, 0, 1], "shadow": 0}

        def flat(*words, **settings):
            width, height, *images = draw(*words, **settings)
            return width, height, *(tuple(np.ravel(image).tolist()) for image in images)

        pictures = {}
        for kind in (np.asarray, flat):
            bullet = SimpleNamespace(**vars(drawing._bullet))
            bullet.getCameraImage = flat if kind is flat else draw
            monkeypatch.setattr(drawing, "_bullet", bullet)
            pictures[kind] = drawing.picture(24, 16, view, frustum, light)
        monkeypatch.undo()
    finally:
        drawing.close()

    kinds = [(16, 24, 3), np.uint8], [(16, 24), np.float32], [(16, 24), np.int32]
    for array, flat_array, (shape, dtype) in zip(*pictures.values(), kinds):
        assert flat_array.shape == array.shape == shape
        assert flat_array.dtype == array.dtype == dtype
        assert np.array_equal(array, flat_array)
    assert set(np.unique(pictures[flat][2])) == {-1, 0}, "the triangle and nothing around it"
