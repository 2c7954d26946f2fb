"""Signs, the projection chain and the voxel grid, against answers worked out without them."""

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


def pose(
    roll_rad: float, pitch_rad: float, yaw_rad: float, position_m: tuple = (3.0, -4.0, 9.0)
) -> Float[Tensor, "4 4"]:
    """world_from_body."""
    rotation = g.rotation_from_euler(f64(roll_rad), f64(pitch_rad), f64(yaw_rad))
    return g.rigid(rotation, f64(position_m))


def random_poses(count: int, seed: int = 0) -> Float[Tensor, "n 4 4"]:
    generator = torch.Generator().manual_seed(seed)
    angles = (torch.rand(3, count, generator=generator, dtype=torch.float64) * 2 - 1) * 0.6
    angles[2] *= math.pi / 0.6
    positions_m = torch.randn(count, 3, generator=generator, dtype=torch.float64) * 40
    return g.rigid(g.rotation_from_euler(*angles), positions_m)


# ------------------------------------------------------------------------------------ rotations


def test_positive_pitch_is_nose_down() -> None:
    forward_world = pose(0, 0.3, 0)[:3, 0]
    torch.testing.assert_close(forward_world, f64(math.cos(0.3), 0.0, -math.sin(0.3)))


def test_positive_roll_is_right_side_down() -> None:
    right_world = -pose(0.3, 0, 0)[:3, 1]
    torch.testing.assert_close(right_world, f64(0.0, -math.cos(0.3), -math.sin(0.3)))


def test_positive_yaw_is_counter_clockwise_from_east() -> None:
    forward_world = pose(0, 0, math.pi / 2)[:3, 0]
    torch.testing.assert_close(forward_world, f64(0.0, 1.0, 0.0))


def test_roll_is_applied_first_and_yaw_last_about_the_axes_of_opencv() -> None:
    about_x, about_y, about_z = (cv2.Rodrigues(axis)[0] for axis in np.diag([0.4, 0.5, 0.6]))
    rotation = g.rotation_from_euler(f64(0.4), f64(0.5), f64(0.6))
    np.testing.assert_allclose(rotation, about_z @ about_y @ about_x, atol=1e-12)


def test_quaternion_is_scalar_last() -> None:
    half_turn_about_z = g.rotation_from_quat(f64(0.0, 0.0, 1.0, 0.0))
    torch.testing.assert_close(half_turn_about_z, torch.diag(f64(-1.0, -1.0, 1.0)))
    torch.testing.assert_close(
        g.quat_from_euler(f64(0.6), f64(0.0), f64(0.0)),
        f64(math.sin(0.3), 0.0, 0.0, math.cos(0.3)),
    )


def test_quaternion_and_euler_give_the_same_rotation() -> None:
    angles = torch.rand(3, 50, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    angles = (angles * 2 - 1) * f64(3.1, 1.5, 3.1)[:, None]
    rotation = g.rotation_from_euler(*angles)
    torch.testing.assert_close(g.rotation_from_quat(g.quat_from_euler(*angles)), rotation)
    torch.testing.assert_close(g.rotation_from_quat(-3 * g.quat_from_euler(*angles)), rotation)
    torch.testing.assert_close(torch.stack(g.euler_from_rotation(rotation)), angles)


# ----------------------------------------------------------------------------- rigid transforms


def test_inverse_is_the_matrix_inverse() -> None:
    world_from_body = random_poses(20)
    torch.testing.assert_close(g.inverse(world_from_body), torch.linalg.inv(world_from_body))


def test_transform_is_the_homogeneous_product() -> None:
    world_from_body = random_poses(4)
    points_body = torch.randn(4, 7, 3, generator=torch.Generator().manual_seed(2)).double()
    homogeneous = torch.cat([points_body, torch.ones(4, 7, 1, dtype=torch.float64)], dim=-1)
    expected = torch.einsum("bij,bnj->bni", world_from_body, homogeneous)[..., :3]
    torch.testing.assert_close(g.transform(world_from_body, points_body), expected)


def test_occ_frame_sits_at_the_uav_with_its_yaw_and_gravity() -> None:
    world_from_occ = g.world_from_occ(pose(*ATTITUDE_RAD))
    cos, sin = math.cos(0.9), math.sin(0.9)
    expected = f64([[cos, -sin, 0, 3], [sin, cos, 0, -4], [0, 0, 1, 9], [0, 0, 0, 1]])
    torch.testing.assert_close(world_from_occ, expected)


def test_occ_from_body_holds_roll_and_pitch_only() -> None:
    occ_from_body = g.occ_from_body(pose(*ATTITUDE_RAD))
    roll_rad, pitch_rad, yaw_rad = g.euler_from_rotation(occ_from_body[:3, :3])
    torch.testing.assert_close(torch.stack([roll_rad, pitch_rad, yaw_rad]), f64(0.31, -0.17, 0.0))
    torch.testing.assert_close(occ_from_body[:3, 3], f64(0.0, 0.0, 0.0))


# ------------------------------------------------------------------------- the projection chain


def expected_pix(
    points_occ: Float[Tensor, "n 3"], roll_rad: float, pitch_rad: float
) -> Float[Tensor, "n 2"]:
    """The image of points by high-school trigonometry: how far ahead, right and down each lies."""
    cr, sr, cp, sp = (f(a) for a in (roll_rad, pitch_rad) for f in (math.cos, math.sin))
    ahead = points_occ @ f64(cp, 0.0, -sp)
    right = points_occ @ -f64(sp * sr, cr, cp * sr)
    down = points_occ @ -f64(sp * cr, -sr, cp * cr)
    focal_pix = WIDTH / 2
    return torch.stack(
        [WIDTH / 2 + focal_pix * right / ahead, HEIGHT / 2 + focal_pix * down / ahead], dim=-1
    )


POINTS_OCC = f64([[12.0, 3.0, -2.0], [20.0, -8.0, 3.0], [35.0, 14.0, -9.0], [9.0, 0.5, 0.0]])


def chain(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float[Tensor, "4 4"]:
    """camera_from_occ of a camera along the body's x axis."""
    return g.camera_from_occ(pose(roll_rad, pitch_rad, yaw_rad), BODY_FROM_CAMERA)


def worst_error_pix(camera_from_occ: Float[Tensor, "4 4"]) -> float:
    pix, _ = g.project(POINTS_OCC, camera_from_occ, PIX_FROM_CAMERA)
    return float((pix - expected_pix(POINTS_OCC, *ATTITUDE_RAD[:2])).norm(dim=-1).max())


def test_projection_under_roll_pitch_and_yaw_is_the_known_one() -> None:
    assert worst_error_pix(chain(*ATTITUDE_RAD)) < 1e-9


def chain_without_yaw(world_from_body: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    level_world_from_occ = g.rigid(torch.eye(3, dtype=torch.float64), world_from_body[:3, 3])
    return g.inverse(BODY_FROM_CAMERA) @ g.inverse(world_from_body) @ level_world_from_occ


def chain_with_transposed_attitude(world_from_body: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    return g.inverse(BODY_FROM_CAMERA) @ g.occ_from_body(world_from_body)


ROLL_RAD, PITCH_RAD, YAW_RAD = ATTITUDE_RAD
WRONG_CHAINS = {
    "roll negated": chain(-ROLL_RAD, PITCH_RAD, YAW_RAD),
    "roll twice": chain(2 * ROLL_RAD, PITCH_RAD, YAW_RAD),
    "roll ignored": chain(0, PITCH_RAD, YAW_RAD),
    "pitch negated": chain(ROLL_RAD, -PITCH_RAD, YAW_RAD),
    "pitch twice": chain(ROLL_RAD, 2 * PITCH_RAD, YAW_RAD),
    "pitch ignored": chain(ROLL_RAD, 0, YAW_RAD),
    "yaw ignored": chain_without_yaw(pose(*ATTITUDE_RAD)),
    "transposed": chain_with_transposed_attitude(pose(*ATTITUDE_RAD)),
}


@pytest.mark.parametrize("wrong", WRONG_CHAINS)
def test_the_known_answer_tells_a_wrong_chain_by_many_pixels(wrong: str) -> None:
    assert worst_error_pix(WRONG_CHAINS[wrong]) > 10


def test_rolling_right_lifts_the_right_end_of_the_horizon() -> None:
    left_and_right = f64([[1000.0, 500.0, 0.0], [1000.0, -500.0, 0.0]])
    pix, _ = g.project(left_and_right, chain(0.2, 0, 1.3), PIX_FROM_CAMERA)
    rise_pix = 112 * 0.5 * math.sin(0.2)
    torch.testing.assert_close(pix[:, 1], f64(64 + rise_pix, 64 - rise_pix))


def test_pitching_the_nose_down_lifts_the_horizon() -> None:
    pix, _ = g.project(f64([[1000.0, 0.0, 0.0]]), chain(0, 0.2, 1.3), PIX_FROM_CAMERA)
    torch.testing.assert_close(pix, f64([[112.0, 64 - 112 * math.tan(0.2)]]))


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


def test_chain_takes_occ_from_body_in_the_place_of_world_from_body() -> None:
    world_from_body = random_poses(30)
    torch.testing.assert_close(
        g.camera_from_occ(g.occ_from_body(world_from_body), BODY_FROM_CAMERA),
        g.camera_from_occ(world_from_body, BODY_FROM_CAMERA),
        rtol=0,
        atol=1e-10,
    )


def test_chain_of_a_level_uav_is_the_mount_alone() -> None:
    body_from_camera = g.front_mount((0.2, -0.1, 0.05), pitch_rad=0.15)
    level = torch.eye(4, dtype=torch.float64)
    expected = g.inverse(body_from_camera)
    torch.testing.assert_close(g.camera_from_occ(level, body_from_camera), expected)
    turned_and_moved = g.camera_from_occ(pose(0, 0, 2.1), body_from_camera)
    torch.testing.assert_close(turned_and_moved, expected)


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
        expected, _ = cv2.projectPoints(
            points_occ.numpy(),
            rotation_vector,
            camera_from_occ[:3, 3].numpy(),
            pix_from_camera.numpy(),
            None,
        )
        np.testing.assert_allclose(pix, expected[:, 0], rtol=0, atol=1e-6)
        torch.testing.assert_close(depth_m, points_camera[:, 2])


def test_depth_is_z_depth_and_not_range() -> None:
    camera_from_occ = g.inverse(BODY_FROM_CAMERA)
    _, depth_m = g.project(f64([[7.0, 5.0, -3.0]]), camera_from_occ, PIX_FROM_CAMERA)
    torch.testing.assert_close(depth_m, f64([7.0]))


def test_unproject_inverts_project() -> None:
    pix = g.pixel_centers(WIDTH, HEIGHT).reshape(-1, 2)[::97]
    depth_m = torch.linspace(0.5, 60, len(pix), dtype=torch.float64)
    points_camera = g.unproject(pix, depth_m, PIX_FROM_CAMERA)
    identity = torch.eye(4, dtype=torch.float64)
    pix_again, depth_again_m = g.project(points_camera, identity, PIX_FROM_CAMERA)
    torch.testing.assert_close(pix_again, pix)
    torch.testing.assert_close(depth_again_m, depth_m)


def test_leading_batch_dimensions() -> None:
    world_from_body = random_poses(6).reshape(2, 3, 4, 4)
    body_from_camera = torch.stack(
        [g.front_mount((0.1, 0.0, 0.0)), g.front_mount((0.0, 0.0, 0.1), pitch_rad=0.2)]
    )[:, None]
    points_occ = POINTS_OCC.expand(2, 3, 4, 3)
    pix_from_camera = PIX_FROM_CAMERA.expand(2, 3, 3, 3)
    camera_from_occ = g.camera_from_occ(world_from_body, body_from_camera)
    pix, depth_m = g.project(points_occ, camera_from_occ, pix_from_camera)
    assert pix.shape == (2, 3, 4, 2)
    assert depth_m.shape == (2, 3, 4)

    for b in range(2):
        for frame in range(3):
            alone = g.camera_from_occ(world_from_body[b, frame], body_from_camera[b, 0])
            expected, _ = g.project(POINTS_OCC, alone, PIX_FROM_CAMERA)
            torch.testing.assert_close(pix[b, frame], expected)


@pytest.mark.parametrize(
    ("function", "inputs"),
    [
        (g.rotation_from_euler, f64([0.3, -0.2, 0.9])),
        (g.quat_from_euler, f64([0.3, -0.2, 0.9])),
        (g.rotation_from_quat, (f64([[0.1, 0.2, -0.3, 0.9]]),)),
        (g.euler_from_rotation, (pose(*ATTITUDE_RAD)[:3, :3],)),
        (g.rigid, (pose(*ATTITUDE_RAD)[:3, :3], f64([3.0, 4.0, 5.0]))),
        (g.inverse, (pose(*ATTITUDE_RAD),)),
        (g.world_from_occ, (pose(*ATTITUDE_RAD),)),
        (g.transform, (pose(*ATTITUDE_RAD), POINTS_OCC)),
        (g.rotate, (pose(*ATTITUDE_RAD), POINTS_OCC)),
        (g.project, (POINTS_OCC, g.inverse(BODY_FROM_CAMERA), PIX_FROM_CAMERA)),
        (g.unproject, (POINTS_OCC[:, :2], POINTS_OCC[:, 2], PIX_FROM_CAMERA)),
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


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_kept(dtype: torch.dtype) -> None:
    world_from_body = pose(*ATTITUDE_RAD).to(dtype)
    camera_from_occ = g.camera_from_occ(world_from_body, BODY_FROM_CAMERA.to(dtype))
    pix, depth_m = g.project(POINTS_OCC.to(dtype), camera_from_occ, PIX_FROM_CAMERA.to(dtype))
    assert {camera_from_occ.dtype, pix.dtype, depth_m.dtype} == {dtype}
    assert g.VoxelGrid().centers(dtype).dtype == dtype


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_finite_even_on_the_focal_plane_and_behind(dtype: torch.dtype) -> None:
    points_occ = torch.tensor(
        [[5.0, 1.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [-5.0, 1.0, 1.0]], dtype=dtype
    ).requires_grad_()
    camera_from_occ = g.inverse(BODY_FROM_CAMERA.to(dtype))
    pix, depth_m = g.project(points_occ, camera_from_occ, PIX_FROM_CAMERA.to(dtype))
    (pix.sum() + depth_m.sum()).backward()
    assert torch.isfinite(pix).all()
    assert torch.isfinite(points_occ.grad).all()


def test_image_holds_its_left_and_upper_edge_only() -> None:
    pix = f64([[0, 0], [223.999, 127.999], [224, 64], [112, 128], [-1e-9, 64], [112, -1e-9]])
    inside = g.in_image(pix, torch.full((6,), 5.0, dtype=torch.float64), WIDTH, HEIGHT)
    assert inside.tolist() == [True, True, False, False, False, False]


def test_image_holds_nothing_behind_the_camera() -> None:
    pix, depth_m = g.project(
        f64([[8.0, 0.0, 0.0], [-8.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        g.inverse(BODY_FROM_CAMERA),
        PIX_FROM_CAMERA,
    )
    assert g.in_image(pix, depth_m, WIDTH, HEIGHT).tolist() == [True, False, False]


def test_pinhole_spans_its_field_of_view() -> None:
    pix_from_camera = g.pinhole(800, 448, math.radians(70))
    edge_rad = math.radians(35)
    edge_camera = f64([[math.tan(edge_rad), 0.0, 1.0], [-math.tan(edge_rad), 0.0, 1.0]])
    pix, _ = g.project(edge_camera, torch.eye(4, dtype=torch.float64), pix_from_camera)
    torch.testing.assert_close(pix, f64([[800.0, 224.0], [0.0, 224.0]]))


def test_pixel_centers() -> None:
    centers = g.pixel_centers(WIDTH, HEIGHT)
    assert centers.shape == (HEIGHT, WIDTH, 2)
    assert centers[0, 0].tolist() == [0.5, 0.5]
    assert centers[2, 5].tolist() == [5.5, 2.5]


def test_front_mount_looks_along_body_x_and_pitches_down() -> None:
    level = g.front_mount((0.1, 0.2, 0.3))
    assert level[:3, 0].tolist() == [0, -1, 0]
    assert level[:3, 1].tolist() == [0, 0, -1]
    assert level[:3, 2].tolist() == [1, 0, 0]
    assert level[:3, 3].tolist() == [0.1, 0.2, 0.3]
    torch.testing.assert_close(
        g.front_mount((0.0, 0.0, 0.0), pitch_rad=0.25)[:3, 2],
        f64(math.cos(0.25), 0.0, -math.sin(0.25)),
    )


# ------------------------------------------------------------------------------- the voxel grid


def test_the_default_grid_is_the_papers() -> None:
    grid = g.VoxelGrid()
    assert grid.shape == (100, 100, 60)
    assert grid.voxel_m == 0.5
    assert (grid.lower_m, grid.upper_m) == ((0.0, -25.0, -20.0), (50.0, 25.0, 10.0))
    centers = grid.centers()
    assert centers.shape == (100, 100, 60, 3)
    assert centers[0, 0, 0].tolist() == [0.25, -24.75, -19.75]
    assert centers[3, 5, 7].tolist() == [1.75, -22.25, -16.25]
    assert centers[-1, -1, -1].tolist() == [49.75, 24.75, 9.75]


@pytest.mark.parametrize("shape", [(100, 100, 60), (50, 50, 30), (25, 25, 15)])
def test_index_of_a_center_is_its_own(shape: tuple[int, int, int]) -> None:
    grid = g.VoxelGrid(shape=shape)
    index, inside = grid.index_of(grid.centers())
    expected = torch.stack(torch.meshgrid(*map(torch.arange, shape), indexing="ij"), dim=-1)
    assert inside.all()
    assert index.dtype == torch.int64
    assert torch.equal(index, expected)


def test_a_voxel_holds_its_lower_face_and_not_its_upper() -> None:
    grid = g.VoxelGrid()
    index, inside = grid.index_of(f64([[1.5, -25.0, -20.0], [1.4999, -24.5, -19.5001]]))
    assert inside.all()
    assert index.tolist() == [[3, 0, 0], [2, 1, 0]]


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
