"""Which convention of a recording is wrong: do surfaces stay where they are from frame to frame?

Labels agree with their own frame whatever its pose; a wrong axis shows where a later frame looks at
the same place. So each suspect is undone in turn: with the right one most surfaces stay.
"""

from collections.abc import Iterator

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .. import geometry
from ..ontology import CAR, FREE, LARGE_VEHICLE, VRU
from .clip import Clip

# With a suspect undone so much more of the surfaces must stay, or nothing is suspected.
ENOUGH = 0.1
# Of our own flights 32 to 58 % stay. Of frames that do not belong together 13 % do.
LEAST = 0.2
# A surface stays if the later frame sees it within this share of its depth.
TOLERANCE = 0.05
TOO_FAST_MPS = 40.0
AFTER_S, FRAMES, STRIDE_PIX = 0.8, 12, 4
MOVING = torch.tensor([LARGE_VEHICLE, CAR, VRU])
AS_RECORDED = "as recorded"
LEFT_HANDED, NORTH_EAST_DOWN = (1.0, -1.0, 1.0), (1.0, -1.0, -1.0)
MIRRORS = {
    "left-handed poses (layout.axes)": LEFT_HANDED,
    "poses of north, east, down (layout.axes)": NORTH_EAST_DOWN,
    "a mirrored x": (-1.0, 1.0, 1.0),
    "a z that points down": (1.0, 1.0, -1.0),
}

Poses = Float[Tensor, "n 4 4"]
Depths = Float[Tensor, "h w"]
Marks = Bool[Tensor, "h w"]


def shares_that_stay(clip: Clip) -> dict[str, float]:
    """Returns the share of the surfaces of a clip that a later frame sees where they were, by what
    is undone: first `AS_RECORDED`. The clip must have been made with aux images."""
    after = max(1, round(AFTER_S * clip.meta.capture_hz))
    frames = torch.linspace(0, len(clip) - 1 - after, FRAMES).long().unique().tolist()
    images = {
        frame: (_depth_m(clip, frame), _stands(clip, frame), _depth_m(clip, frame + after))
        for frame in frames
    }
    by_ray = _reach(clip)

    shares: dict[str, float] = {}
    for name, poses, scale in _suspects(clip.world_from_body, by_ray, clip.meta.capture_hz):
        stays = total = 0
        for frame, (depth_m, stands, later_m) in images.items():
            pair = poses[[frame, frame + after]]
            stays += _staying(clip, pair, depth_m * scale, stands, later_m * scale)
            total += int(stands.sum())
        # Several forms of one suspect have one name.
        shares[name] = max(shares.get(name, 0.0), stays / max(1, total))
    return shares


def doubt_of(shares: dict[str, float]) -> str:
    """Returns what to look at first in a recording, of the shares that stay; empty if nothing."""
    first, best = shares[AS_RECORDED], max(shares, key=shares.get)
    if shares[best] < first + ENOUGH:
        if first >= LEAST:
            return ""
        return (
            f"only {first:.0%} of its surfaces stay where they are for {AFTER_S:g} s; do images, "
            "depth and poses of one frame belong together?"
        )
    return (
        f"{first:.0%} of its surfaces stay where they are for {AFTER_S:g} s; {shares[best]:.0%} do "
        f"if one undoes {best}: look there first, and annotate again"
    )


def _suspects(
    poses: Poses, by_ray: Tensor, capture_hz: float
) -> Iterator[tuple[str, Poses, Tensor]]:
    """Yields each suspect with the poses, and the factor of the depth, that undo it."""
    one = torch.ones_like(by_ray)
    yield AS_RECORDED, poses, one
    yield "depth along the ray (layout.depth)", poses, 1 / by_ray
    yield "depth along the axis, taken for the ray's", poses, by_ray
    for name, signs in MIRRORS.items():
        yield name, _mirrored(poses, signs), one

    turned = poses[:, :3, :3].transpose(-1, -2)
    yield "rotations from the world to the body", geometry.rigid(turned, poses[:, :3, 3]), one
    # Without motion most surfaces stay, too: only where it is too fast for a flight.
    steps_m = poses[:, :3, 3].diff(dim=0).norm(dim=-1)
    if steps_m.median() * capture_hz > TOO_FAST_MPS:
        yield "centimetres", geometry.rigid(poses[:, :3, :3], poses[:, :3, 3] / 100), one
    for axes in ((1.0, 1.0, 1.0), LEFT_HANDED, NORTH_EAST_DOWN):
        theirs = _mirrored(poses, axes)
        quat = geometry.quat_from_euler(*geometry.euler_from_rotation(theirs[:, :3, :3]))
        for shift in (1, -1):
            rotation = geometry.rotation_from_quat(quat.roll(shift, dims=-1))
            undone = _mirrored(geometry.rigid(rotation, theirs[:, :3, 3]), axes)
            yield "the order of the quaternion's columns", undone, one


def _mirrored(poses: Poses, signs: tuple[float, float, float]) -> Poses:
    mirror = torch.diag(torch.tensor([*signs, 1.0], dtype=poses.dtype))
    return mirror @ poses @ mirror


def _staying(clip: Clip, pair: Poses, depth_m: Depths, stands: Marks, later_m: Depths) -> int:
    """Counts the standing pixels of a frame whose points the later frame sees where they were."""
    meta = clip.meta
    pix = geometry.pixel_centers(meta.width, meta.height)[stands]
    points = geometry.unproject(pix, depth_m[stands], meta.pix_from_camera)
    world_from_camera = pair @ meta.body_from_camera
    later_from_first = geometry.inverse(world_from_camera[1]) @ world_from_camera[0]
    seen = geometry.transform(later_from_first, points)

    identity = torch.eye(4, dtype=seen.dtype)
    there, away_m = geometry.project(seen, identity, meta.pix_from_camera)
    inside = geometry.in_image(there, away_m, meta.width, meta.height)
    u, v = there[inside].long().unbind(-1)
    off_m = (later_m[v, u] - away_m[inside]).abs()
    return int((off_m <= TOLERANCE * away_m[inside]).sum())


def _depth_m(clip: Clip, frame: int) -> Depths:
    return torch.from_numpy(clip.aux("depth", frame)).double()


def _stands(clip: Clip, frame: int) -> Marks:
    """Returns every few pixels of what does not move."""
    class_id = torch.from_numpy(clip.aux("class", frame))
    stands = (class_id < FREE) & ~torch.isin(class_id, MOVING)
    chosen = torch.zeros_like(stands)
    chosen[::STRIDE_PIX, ::STRIDE_PIX] = True
    return stands & chosen & torch.isfinite(_depth_m(clip, frame))


def _reach(clip: Clip) -> Depths:
    """Returns how much longer than its depth along the axis the ray of each pixel is."""
    pix = geometry.pixel_centers(clip.meta.width, clip.meta.height)
    depth_m = torch.ones_like(pix[..., 0])
    return geometry.unproject(pix, depth_m, clip.meta.pix_from_camera).norm(dim=-1)
