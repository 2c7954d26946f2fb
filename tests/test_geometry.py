"""Signs, the projection chain and the voxel grid, against answers worked out without them.

``docs/conventions.md``, which test_conventions executes, has the axes of every frame, the signs of
the angles, and the grid's corners.
"""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from src import geometry as g
from src.errors import UserError

WIDTH, HEIGHT = 224, 128
PIX_FROM_CAMERA = g.pinhole(WIDTH, HEIGHT, math.radians(90))
BODY_FROM_CAMERA = g.front_mount((0.0, 0.0, 0.0))
ATTITUDE_RAD = (0.31, -0.17, 0.9)


def f64(*values: object) -> Float[Tensor, "..."]:
    return torch.tensor(values if len(values) > 1 else values[0], dtype=torch.float64)


def pose(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float[Tensor, "4 4"]:
    """world_from_body."""
    rotation = g.rotation_from_euler(f64(roll_rad), f64(pitch_rad), f64(yaw_rad))
    return g.rigid(rotation, f64(3.0, -4.0, 9.0))


def random_poses(count: int, seed: int = 0) -> Float[Tensor, "n 4 4"]:
    generator = torch.Generator().manual_seed(seed)
    angles = (torch.rand(3, count, generator=generator, dtype=torch.float64) * 2 - 1) * 0.6
    angles[2] *= math.pi / 0.6
    positions_m = torch.randn(count, 3, generator=generator, dtype=torch.float64) * 40
    return g.rigid(g.rotation_from_euler(*angles), positions_m)


# ------------------------------------------------------------------------------------ rotations


def test_roll_is_applied_first_and_yaw_last_about_the_axes_of_opencv() -> None:
    about_x, about_y, about_z = (cv2.Rodrigues(axis)[0] for axis in np.diag([0.4, 0.5, 0.6]))
    rotation = g.rotation_from_euler(f64(0.4), f64(0.5), f64(0.6))
    np.testing.assert_allclose(rotation, about_z @ about_y @ about_x, atol=1e-12)


def test_quaternion_and_euler_give_the_same_rotation() -> None:
    angles = torch.rand(3, 50, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    angles = (angles * 2 - 1) * f64(3.1, 1.5, 3.1)[:, None]
    rotation = g.rotation_from_euler(*angles)
    torch.testing.assert_close(g.rotation_from_quat(g.quat_from_euler(*angles)), rotation)
    torch.testing.assert_close(g.rotation_from_quat(-3 * g.quat_from_euler(*angles)), rotation)
    torch.testing.assert_close(torch.stack(g.euler_from_rotation(rotation)), angles)


# ------------------------------------------------------------------------- the projection chain


POINTS_OCC = f64([[12.0, 3.0, -2.0], [20.0, -8.0, 3.0], [35.0, 14.0, -9.0], [9.0, 0.5, 0.0]])


def test_chain_is_the_papers_product() -> None:
    world_from_body = random_poses(30)
    body_from_camera = g.front_mount((0.2, -0.1, 0.05), pitch_rad=0.15)
    for pose_matrix in world_from_body.numpy():
        yaw_rad = math.atan2(pose_matrix[1, 0], pose_matrix[0, 0])
        world_from_occ = np.eye(4)
        world_from_occ[:3, :3], _ = cv2.Rodrigues(np.array([0.0, 0.0, yaw_rad]))
        world_from_occ[:3, 3] = pose_matrix[:3, 3]
        camera_from_world = np.linalg.inv(pose_matrix @ body_from_camera.numpy())
        result = g.camera_from_occ(torch.from_numpy(pose_matrix), body_from_camera)
        np.testing.assert_allclose(result, camera_from_world @ world_from_occ, atol=1e-10)


def test_project_agrees_with_opencv() -> None:
    generator = torch.Generator().manual_seed(3)
    body_from_camera = g.front_mount((0.2, -0.1, 0.05), pitch_rad=0.15)
    pix_from_camera = f64([[180.0, 0.0, 101.3], [0.0, 175.0, 66.6], [0.0, 0.0, 1.0]])
    points_camera = torch.rand(40, 3, generator=generator, dtype=torch.float64) * f64(20, 10, 40)
    points_camera += f64(-10.0, -5.0, 1.0)

    for world_from_body in random_poses(25, seed=4):
        camera_from_occ = g.camera_from_occ(world_from_body, body_from_camera)
        points_occ = g.transform(torch.linalg.inv(camera_from_occ), points_camera)
        pix, depth_m = g.project(points_occ, camera_from_occ, pix_from_camera)
        rotation_vector, _ = cv2.Rodrigues(camera_from_occ[:3, :3].numpy())
        camera = rotation_vector, camera_from_occ[:3, 3].numpy(), pix_from_camera.numpy()
        expected, _ = cv2.projectPoints(points_occ.numpy(), *camera, None)
        np.testing.assert_allclose(pix, expected[:, 0], rtol=0, atol=1e-6)
        torch.testing.assert_close(depth_m, points_camera[:, 2])


def test_unproject_inverts_project_of_pixel_centers() -> None:
    centers = g.pixel_centers(WIDTH, HEIGHT)
    assert centers.shape == (HEIGHT, WIDTH, 2)
    assert centers[2, 5].tolist() == [5.5, 2.5]
    pix = centers.reshape(-1, 2)[::97]
    depth_m = torch.linspace(0.5, 60, len(pix), dtype=torch.float64)
    points_camera = g.unproject(pix, depth_m, PIX_FROM_CAMERA)
    identity = torch.eye(4, dtype=torch.float64)
    pix_again, depth_again_m = g.project(points_camera, identity, PIX_FROM_CAMERA)
    torch.testing.assert_close(pix_again, pix)
    torch.testing.assert_close(depth_again_m, depth_m)


def test_leading_batch_dimensions() -> None:
    world_from_body = random_poses(6).reshape(2, 3, 4, 4)
    mounts = g.front_mount((0.1, 0.0, 0.0)), g.front_mount((0.0, 0.0, 0.1), pitch_rad=0.2)
    body_from_camera = torch.stack(mounts)[:, None]
    points_occ = POINTS_OCC.expand(2, 3, 4, 3)
    pix_from_camera = PIX_FROM_CAMERA.expand(2, 3, 3, 3)
    camera_from_occ = g.camera_from_occ(world_from_body, body_from_camera)
    pix, depth_m = g.project(points_occ, camera_from_occ, pix_from_camera)
    assert (pix.shape, depth_m.shape) == ((2, 3, 4, 2), (2, 3, 4))

    for b in range(2):
        for frame in range(3):
            alone = g.camera_from_occ(world_from_body[b, frame], body_from_camera[b, 0])
            expected, _ = g.project(POINTS_OCC, alone, PIX_FROM_CAMERA)
            torch.testing.assert_close(pix[b, frame], expected)


@pytest.mark.parametrize(
    ("function", "inputs"),
    [
        (g.rotation_from_euler, f64([0.3, -0.2, 0.9])),
        (g.euler_from_rotation, (pose(*ATTITUDE_RAD)[:3, :3],)),
        (g.transform, (pose(*ATTITUDE_RAD), POINTS_OCC)),
        (g.project, (POINTS_OCC, g.inverse(BODY_FROM_CAMERA), PIX_FROM_CAMERA)),
        (g.in_image, (POINTS_OCC[:, :2], POINTS_OCC[:, 2], WIDTH, HEIGHT)),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_numpy_arrays_give_arrays_of_the_same_numbers(function: Callable, inputs: tuple) -> None:
    plain = [value.numpy() if isinstance(value, Tensor) else value for value in inputs]
    arrays, tensors = function(*plain), function(*inputs)
    arrays, tensors = (v if isinstance(v, tuple) else (v,) for v in (arrays, tensors))
    for array, tensor in zip(arrays, tensors, strict=True):
        assert isinstance(array, np.ndarray)
        assert array.dtype == tensor.numpy().dtype
        np.testing.assert_allclose(array, tensor, atol=1e-14)


def test_arrays_of_single_and_double_precision_go_together_and_find_their_voxels() -> None:
    world_from_body = pose(*ATTITUDE_RAD)
    points = POINTS_OCC.numpy().astype(np.float32)
    expected = g.transform(world_from_body, torch.from_numpy(points).double())
    found = g.transform(world_from_body.numpy(), points)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, expected)

    grid = g.VoxelGrid()
    index, inside = grid.index_of(POINTS_OCC.numpy())
    for array, tensor in zip((index, inside), grid.index_of(POINTS_OCC)):
        assert np.array_equal(array, tensor)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_kept_and_gradients_are_finite_even_behind_the_camera(dtype: torch.dtype) -> None:
    """And on the focal plane, where a division by the depth would be one by nothing."""
    points = [[5.0, 1.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [-5.0, 1.0, 1.0]]
    points_occ = torch.tensor(points, dtype=dtype, requires_grad=True)
    level = torch.eye(4, dtype=dtype)
    camera_from_occ = g.camera_from_occ(level, BODY_FROM_CAMERA.to(dtype))
    pix, depth_m = g.project(points_occ, camera_from_occ, PIX_FROM_CAMERA.to(dtype))
    (pix.sum() + depth_m.sum()).backward()
    assert {camera_from_occ.dtype, pix.dtype, depth_m.dtype} == {dtype}
    assert g.VoxelGrid().centers(dtype).dtype == dtype
    assert torch.isfinite(pix).all()
    assert torch.isfinite(points_occ.grad).all()


def test_image_holds_its_left_and_upper_edge_and_nothing_behind_the_camera() -> None:
    edges = [[0, 0], [223.999, 127.999], [224, 64], [112, 128], [-1e-9, 64], [112, -1e-9]]
    inside = g.in_image(f64(edges), f64([5.0] * 6), WIDTH, HEIGHT)
    assert inside.tolist() == [True, True, False, False, False, False]
    points_occ, level = f64([[8.0, 0, 0], [-8.0, 0, 0], [0.0, 0, 0]]), g.inverse(BODY_FROM_CAMERA)
    pix, depth_m = g.project(points_occ, level, PIX_FROM_CAMERA)
    assert g.in_image(pix, depth_m, WIDTH, HEIGHT).tolist() == [True, False, False]


def test_pinhole_spans_its_field_of_view() -> None:
    pix_from_camera = g.pinhole(800, 448, math.radians(70))
    edge_rad = math.radians(35)
    edge_camera = f64([[math.tan(edge_rad), 0.0, 1.0], [-math.tan(edge_rad), 0.0, 1.0]])
    pix, _ = g.project(edge_camera, torch.eye(4, dtype=torch.float64), pix_from_camera)
    torch.testing.assert_close(pix, f64([[800.0, 224.0], [0.0, 224.0]]))


def test_a_mount_has_its_position_and_its_pitch_is_downwards() -> None:
    body_from_camera = g.front_mount((0.1, 0.2, 0.3), pitch_rad=0.25)
    assert body_from_camera[:3, 3].tolist() == [0.1, 0.2, 0.3]
    forward = f64(math.cos(0.25), 0.0, -math.sin(0.25))
    torch.testing.assert_close(body_from_camera[:3, 2], forward)


# ------------------------------------------------------------------------------- the voxel grid


@pytest.mark.parametrize("shape", [(100, 100, 60), (50, 50, 30), (25, 25, 15)])
def test_index_of_a_center_is_its_own(shape: tuple[int, int, int]) -> None:
    grid = g.VoxelGrid(shape=shape)
    index, inside = grid.index_of(grid.centers())
    expected = torch.stack(torch.meshgrid(*map(torch.arange, shape), indexing="ij"), dim=-1)
    assert inside.all()
    assert index.dtype == torch.int64
    assert torch.equal(index, expected)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bounds_are_half_open_and_floor_comes_first(axis: int, dtype: torch.dtype) -> None:
    grid = g.VoxelGrid()
    points = torch.tensor([[10.0, 1.0, 1.0]], dtype=dtype).repeat(4, 1)
    lower_m, upper_m = grid.lower_m[axis], grid.upper_m[axis]
    # Truncation towards zero would take the first, a fifth of a voxel too low, for index 0.
    points[:, axis] = torch.tensor([lower_m - 0.1, lower_m, upper_m - 0.01, upper_m], dtype=dtype)
    index, inside = grid.index_of(points)
    assert inside.tolist() == [False, True, True, False]
    assert index[:, axis].tolist() == [-1, 0, grid.shape[axis] - 1, grid.shape[axis]]


@pytest.mark.parametrize("dtype", [">f4", "longdouble", "uint16"])
def test_arrays_of_any_kind_of_number_become_tensors(dtype: str) -> None:
    array = np.arange(6).reshape(2, 3).astype(dtype)[:, ::-1]
    assert g.tensor_of(array).tolist() == [[2, 1, 0], [5, 4, 3]]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_that_are_nowhere_are_outside(value: float, axis: int) -> None:
    point = torch.tensor([10.0, 1.0, 1.0])
    point[axis] = value
    grid = g.VoxelGrid()
    index, inside = grid.index_of(point)
    assert not inside
    assert not 0 <= index[axis] < grid.shape[axis]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"shape": (100, 100, 50)}, "grid.shape"),
        ({"shape": (100, 50, 60)}, "cubes"),
        ({"shape": (0, 100, 60)}, "empty"),
        ({"upper_m": (0.0, 25.0, 10.0)}, "empty"),
    ],
)
def test_a_grid_that_is_not_of_cubes_is_refused_in_one_line(change: dict, word: str) -> None:
    with pytest.raises(UserError, match=word) as caught:
        g.VoxelGrid(**change)
    assert "\n" not in str(caught.value)


def test_grids_compare_and_hash_by_value_whatever_sequence_they_came_from() -> None:
    from_lists = g.VoxelGrid([0, -25, -20], [50, 25, 10], [100, 100, 60])
    assert from_lists == g.VoxelGrid()
    assert hash(from_lists) == hash(g.VoxelGrid())
