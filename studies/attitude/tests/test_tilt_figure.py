"""The figure of a tilted frame: labels on their objects with the true camera, beside them else."""

import numpy as np
import pytest
from PIL import Image

from src.geometry import VoxelGrid
from src.ontology import CAR, FREE
from src.report.scene import VoxelScene
from src.report.voxels import COLOR_SHARE, PALETTE, labels_in_image
from studies.attitude.tilt_figure import draw_tilt
from tests.report.street import HEIGHT, WIDTH, fill, street, tilted_frustum

GRID = VoxelGrid(shape=(50, 50, 30))
BLACK = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)


def place_of_a_car(camera, z_m=0):
    """Row and column of the middle of the color of a car straight ahead, at some height."""
    labels = np.full(GRID.shape, FREE, dtype=np.uint8)
    fill(labels, GRID, CAR, (20, -1, z_m - 1), (22, 1, z_m + 1))
    tinted = labels_in_image(BLACK, labels, GRID, camera)
    seen = (tinted > 0).any(axis=-1)
    assert np.abs(tinted[seen].max(axis=0) - COLOR_SHARE * PALETTE[CAR]).max() <= 1
    return np.argwhere(seen).mean(axis=0)


def test_labels_lie_where_the_camera_sees_them():
    """The mount looks 15 degrees down, and the car is straight ahead: above the image's middle."""
    middle, focal = np.array([HEIGHT, WIDTH]) / 2, WIDTH / 2
    level = place_of_a_car(tilted_frustum(0.0, 0.0))
    assert level == pytest.approx(middle - [focal * np.tan(np.radians(15)), 0], abs=1.5)
    # Nose down, things move up in the image.
    assert place_of_a_car(tilted_frustum(0.0, 0.1))[0] < level[0] - 8
    # Right side down turns the image about what is straight ahead; what is below moves right.
    rolled = tilted_frustum(0.3, 0.0)
    assert place_of_a_car(rolled) == pytest.approx(level, abs=1)
    assert place_of_a_car(rolled, -6)[1] > level[1] + 5


def test_the_two_rows_differ_in_nothing_but_the_camera(tmp_path):
    tilted, level = tilted_frustum(0.2, 0.15), tilted_frustum(0.0, 0.0)
    truth = street(GRID, tilted)
    pages = {}
    for name, other in {"level": level, "same": tilted}.items():
        scene = VoxelScene("downtown frame 3", GRID, BLACK, truth, {}, tilted)
        draw_tilt(scene, other, tmp_path / f"{name}.png")
        with Image.open(tmp_path / f"{name}.png") as page:
            pages[name] = np.asarray(page)
    height = 440  # of a row, its title included
    first, second = (pages["same"][at : at + 380, 740:] for at in (110, 110 + height))
    assert (first == second).all()
    assert (pages["level"][110:490, 740:] == first).all()
    assert (pages["level"][110 + height : 490 + height, 740:] != second).any()
