"""The bullet client: what it draws, and what it leaves behind."""

import tracemalloc

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
