"""task=check: are the bytes those written, do attitudes agree, do labels lie in their image?"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import torch

from .. import geometry
from ..ontology import FREE, SKY, UNKNOWN
from .clip import Clip, damaged_files


def shares_of(counts: Counter) -> dict[str, float]:
    """Returns shares of the pixels and of the free voxels that `agreement_of` counted."""
    pixels, free = max(1, counts["pixels"]), max(1, counts["free voxels"])
    return {
        "pixels in a voxel of their class": counts["own class"] / pixels,
        "pixels in an occupied voxel": counts["occupied"] / pixels,
        "free voxels that hold a pixel's point": counts["free with point"] / free,
    }


def problems_of(clip_folder: Path) -> Iterator[str]:
    """Yields a line for each thing that is wrong with a clip."""
    damaged = damaged_files(clip_folder)
    for name in damaged:
        yield f"{clip_folder / name}: its bytes are not the ones written"
    # Damaged files cannot be read to be checked further.
    if damaged:
        return

    clip = Clip(clip_folder)
    meta, poses = clip.meta, clip.world_from_body
    angles = torch.stack(geometry.euler_from_rotation(poses[:, :3, :3]), dim=-1)
    table = torch.tensor(clip.frames[["roll_rad", "pitch_rad", "yaw_rad"]].to_numpy())
    # Angles that differ by a whole turn are equal.
    turn = torch.remainder(angles - table + torch.pi, 2 * torch.pi) - torch.pi
    for frame in (turn.abs().amax(dim=-1) > 1e-6).nonzero().flatten().tolist():
        yield f"{clip.folder}: frame {frame}: roll, pitch, yaw are not those of the quaternion"

    centers = meta.grid.centers(torch.float64)
    for frame, world_from_body in enumerate(poses):
        chain = geometry.camera_from_occ(world_from_body, meta.body_from_camera)
        # App. A.3 supervises only voxels whose center projects into the image. A wrong attitude
        # in the projection chain leaves some outside.
        labelled = torch.from_numpy(clip.semantics(frame) != UNKNOWN)
        pix, depth_m = geometry.project(centers[labelled], chain, meta.pix_from_camera)
        if outside := int((~geometry.in_image(pix, depth_m, meta.width, meta.height)).sum()):
            yield f"{clip.folder}: frame {frame}: {outside} voxels outside the image carry labels"


def agreement_of(clip: Clip, frame: int) -> Counter:
    """Counts the depth pixels of a frame against its labels; `shares_of` divides such counts.

    A pixel can be judged when its point lies in the grid and its voxel's center in the image. The
    clip must have been made with aux images.
    """
    meta = clip.meta
    depth_m, class_id = (torch.from_numpy(clip.aux(name, frame)) for name in ("depth", "class"))
    hit = class_id != SKY
    pix = geometry.pixel_centers(meta.width, meta.height)[hit]
    points_camera = geometry.unproject(pix, depth_m[hit].double(), meta.pix_from_camera)

    # In the occ frame neither place nor yaw matters, so roll and pitch are enough.
    tilt = geometry.occ_from_body(clip.world_from_body[frame])
    points_occ = geometry.transform(tilt @ meta.body_from_camera, points_camera)
    index, inside = meta.grid.index_of(points_occ)
    index, own = index[inside], class_id[hit][inside]

    # A voxel is labelled by its center, which may be outside where the point is inside.
    centers = meta.grid.centers(torch.float64)[tuple(index.T)]
    chain = geometry.inverse(meta.body_from_camera) @ geometry.inverse(tilt)
    in_view = geometry.in_image(
        *geometry.project(centers, chain, meta.pix_from_camera), meta.width, meta.height
    )
    voxels, own = tuple(index[in_view].T), own[in_view]

    semantics = torch.from_numpy(clip.semantics(frame))
    holds_point = torch.zeros(meta.grid.shape, dtype=torch.bool)
    holds_point[voxels] = True
    free = semantics == FREE
    counts = {
        "pixels": len(own),
        "occupied": (semantics[voxels] < FREE).sum(),
        "own class": (semantics[voxels] == own).sum(),
        "free voxels": free.sum(),
        "free with point": (free & holds_point).sum(),
    }
    return Counter({name: int(count) for name, count in counts.items()})
