"""The batch that the loader hands to the model."""

from typing import TypedDict

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from ..geometry import euler_from_rotation, inverse, occ_from_body, world_from_occ


class PixelLabels(TypedDict, total=False):
    """What the pixels of the current images see, on a raster a fourth as fine: with model/sight=on.

    The sky has the class of free space, and an infinite depth.
    """

    pixel_class: UInt8[Tensor, "B h w"]
    # z-depth.
    pixel_depth_m: Float[Tensor, "B h w"]


class Batch(PixelLabels):
    """B windows of L frames, oldest first, the current one last. A single sample has no B.

    Frame directions are in the names; velocities and labels are in the current occ frame.
    ``clip`` and ``frame`` say where the current frame comes from.
    """

    # The current one alone, [B, 1, 3, H, W], where the past was computed in earlier steps.
    image: UInt8[Tensor, "B L 3 H W"]
    # With model/parallax=on, of the current frame.
    parallax: UInt8[Tensor, "B bins h w"]
    pix_from_camera: Float[Tensor, "B L 3 3"]
    body_from_camera: Float[Tensor, "B 4 4"]
    # Rotation by roll and pitch only.
    occ_from_body: Float[Tensor, "B L 4 4"]
    # The identity for the current frame.
    occ_from_past_occ: Float[Tensor, "B L 4 4"]
    # False where the clip had no such past frame; what is in its place means nothing.
    history_valid: Bool[Tensor, "B L"]
    velocity_mps: Float[Tensor, "B 3"]
    # Roll and pitch.
    attitude_rad: Float[Tensor, "B 2"]
    # The UAV's height above the world's ground plane, from which flat ground is a little off.
    height_m: Float[Tensor, "B"]
    semantics: UInt8[Tensor, "B X Y Z"]
    visible: Bool[Tensor, "B X Y Z"]
    clip: list[str]
    frame: list[int]


def ego_motion(
    world_from_body: Float[Tensor, "L 4 4"], velocity_world_mps: Float[Tensor, "3"]
) -> dict[str, Tensor]:
    """Computes a sample's motion from the transforms of its frames (oldest first) and its velocity.

    The precision is that of the transforms, whose origins may be far away; the result is float32.
    """
    # The chain goes through the world, which the past and the current frame share.
    occ_now_from_world = inverse(world_from_occ(world_from_body[-1]))
    roll_pitch_yaw_rad = torch.stack(euler_from_rotation(world_from_body[-1, :3, :3]))

    motion = {
        "occ_from_body": occ_from_body(world_from_body),
        "occ_from_past_occ": occ_now_from_world @ world_from_occ(world_from_body),
        "velocity_mps": occ_now_from_world[:3, :3] @ velocity_world_mps,
        "attitude_rad": roll_pitch_yaw_rad[:2],
        "height_m": world_from_body[-1, 2, 3],
    }
    return {name: value.float() for name, value in motion.items()}


def mirrored(sample: Batch) -> Batch:
    """Mirrors a sample exactly: left and right of the world change places.

    With M = diag(1, -1, 1) in the occ and body frames and diag(-1, 1, 1) in the camera's, every
    transform b_from_a becomes M_b b_from_a M_a; rotations stay proper, and u becomes W - u. Only
    the places of the cost volume and of the pixels' labels, which stand at pixel 4i + 2, are then
    those of pixel 4j + 1: one pixel beside their own.
    """
    # Left is y in the occ and body frames, and x in the camera's.
    swap_y = sample["body_from_camera"].new_tensor([1, -1, 1, 1])
    swap_x = swap_y.new_tensor([-1, 1, 1, 1])
    sides = swap_y[:, None] * swap_y

    # Skew changes its sign with u; the principal point moves to the other side.
    pix_from_camera = sample["pix_from_camera"].clone()
    pix_from_camera[..., 0, 1] *= -1
    pix_from_camera[..., 0, 2] = sample["image"].shape[-1] - pix_from_camera[..., 0, 2]

    of_pixels = ("image", "parallax", "pixel_class", "pixel_depth_m")
    return {
        **sample,
        **{name: sample[name].flip(-1) for name in of_pixels if name in sample},
        "pix_from_camera": pix_from_camera,
        "body_from_camera": swap_y[:, None] * sample["body_from_camera"] * swap_x,
        "occ_from_body": sample["occ_from_body"] * sides,
        "occ_from_past_occ": sample["occ_from_past_occ"] * sides,
        "velocity_mps": sample["velocity_mps"] * swap_y[:3],
        # A mirror turns a roll around and leaves a pitch.
        "attitude_rad": sample["attitude_rad"] * swap_y.new_tensor([-1, 1]),
        "semantics": sample["semantics"].flip(-2),
        "visible": sample["visible"].flip(-2),
    }
