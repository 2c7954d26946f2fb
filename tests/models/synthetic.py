"""A small network and a synthetic batch, with the shapes and dtypes of `src.data`."""

import functools
import math

import torch

from src.geometry import VoxelGrid, front_mount, pinhole, rigid, rotation_from_euler
from src.models.attention import DeformableCrossAttention
from src.models.backbone import ResNet
from src.models.bilinear_lift import BilinearLift
from src.models.decoder import PillarDecoder
from src.models.encoder import PillarEncoder
from src.models.evidence import Evidence
from src.models.ground import GroundVolume
from src.models.lift_splat import LiftSplat
from src.models.losses import OccupancyLoss, cross_entropy, lovasz
from src.models.network import SkyOcc
from src.models.references import References, padded_index
from src.models.sight import Sight, SightHead, place_of
from src.ontology import NUM_CLASSES, UNKNOWN

GRID = VoxelGrid(shape=(10, 10, 6))
# A volume of the same pillars, on the ground.
VOLUME = VoxelGrid((0, -25, -5), (50, 25, 15), (10, 10, 4))
IMAGE_SIZE = (96, 64)
# Of the cost volumes of a batch.
BINS = 12
LIFTS = ("deformable", "bilinear", "lss")


def build_lift(name, grid=GRID, num_heads=2):
    """What builds a layer's lift, by the name of its configuration."""
    return {
        "deformable": functools.partial(DeformableCrossAttention, num_heads=num_heads),
        "bilinear": BilinearLift,
        "lss": functools.partial(LiftSplat, grid=grid),
    }[name]


def build_network(
    grid=GRID,
    dim=16,
    num_layers=2,
    encoder=None,
    lift="deformable",
    backbone=None,
    volume=None,
    parallax=None,
    **network,
):
    """With a ``parallax``, what pixels see is read from it, and is evidence for the voxels."""
    torch.manual_seed(0)
    backbone = backbone or ResNet(depth=18, width=8)
    ground = None if volume is None else GroundVolume(volume, grid)
    volume = volume or grid
    sizes = {"dim": dim, "num_layers": num_layers, "num_heights": 4, "num_heads": 2}
    encoder = PillarEncoder(volume, build_lift(lift, volume), **{**sizes, **(encoder or {})})
    decoder = PillarDecoder(volume, dim, num_blocks=1)
    if parallax is not None:
        network["sight"] = SightHead(dim, parallax.bins, parallax=parallax)
        network["evidence"] = Evidence(volume, dim, parallax.bins, encoder.references.projection)
    return SkyOcc(backbone, encoder, decoder, ground=ground, **network)


def build_loss(class_weights=None, lovasz_weight=1.0):
    """The paper's loss, Eq. 10."""
    terms = {
        "cross_entropy": functools.partial(cross_entropy, class_weights=class_weights),
        "lovasz": functools.partial(lovasz, weight=lovasz_weight),
    }
    return OccupancyLoss(terms)


def loss_of(network, batch, loss=None):
    """The paper's loss of a batch, with its graph."""
    return (loss or build_loss())(network(batch), batch["semantics"])["total"]


def build_references(pix, valid, room=None):
    """References at ``pix`` [B, P, J, 2]; with ``room``, so many places a frame in ``in_view``."""
    in_view = valid.flatten().nonzero()[:, 0]
    if room is not None:
        in_view = padded_index(valid.flatten(1), room)
    eye = torch.eye(4).expand(len(pix), 4, 4)
    return References(pix, torch.ones_like(pix[..., 0]), valid, in_view, eye, eye[:, :3, :3])


def seen_by(references, attitudes_rad, mount, height_m=None):
    """What UAVs of these rolls and pitches see of `PillarReferences`."""
    roll, pitch = torch.tensor(attitudes_rad).T
    tilts = rigid(rotation_from_euler(roll, pitch, 0 * roll), torch.zeros(3))
    mounts = mount.float().expand(len(tilts), 4, 4)
    cameras = pinhole(*IMAGE_SIZE, math.radians(90)).float().expand(len(tilts), 3, 3)
    return references(tilts, mounts, cameras, IMAGE_SIZE, height_m)


def build_batch(batch_size=2, frames=4, grid=GRID, image_size=IMAGE_SIZE, seed=0):
    generator = torch.Generator().manual_seed(seed)
    width, height = image_size
    shape = (batch_size, frames)
    roll, pitch, yaw = 0.15 * torch.randn(3, *shape, generator=generator)
    zero = torch.zeros(shape)
    occ_from_past_occ = rigid(
        rotation_from_euler(zero, zero, yaw), torch.randn(*shape, 3, generator=generator)
    )
    occ_from_past_occ[:, -1] = torch.eye(4)
    occ_from_body = rigid(rotation_from_euler(roll, pitch, zero), torch.zeros(*shape, 3))
    body_from_camera = front_mount((0.2, 0.0, 0.0)).float().expand(batch_size, 4, 4)
    pix_from_camera = pinhole(width, height, math.radians(90)).float()
    visible = torch.rand(batch_size, *grid.shape, generator=generator) < 0.4
    pixels = batch_size, height // 4, width // 4
    labels = torch.randint(0, 9, visible.shape, generator=generator, dtype=torch.uint8)
    return {
        "image": torch.randint(
            0, 256, (*shape, 3, height, width), generator=generator, dtype=torch.uint8
        ),
        "pix_from_camera": pix_from_camera.expand(*shape, 3, 3),
        "body_from_camera": body_from_camera,
        "occ_from_body": occ_from_body,
        "occ_from_past_occ": occ_from_past_occ,
        "history_valid": torch.ones(shape, dtype=torch.bool),
        "velocity_mps": 5 * torch.randn(batch_size, 3, generator=generator),
        "attitude_rad": torch.stack([roll, pitch], dim=-1)[:, -1],
        "height_m": 3 + 10 * torch.rand(batch_size, generator=generator),
        "semantics": labels.masked_fill(~visible, UNKNOWN),
        "visible": visible,
        "pixel_class": torch.randint(0, 9, pixels, generator=generator, dtype=torch.uint8),
        "pixel_depth_m": 80 * torch.rand(pixels, generator=generator),
        "parallax": torch.randint(
            0, 256, (batch_size, BINS, *pixels[1:]), generator=generator, dtype=torch.uint8
        ),
    }


def sure_sight(depth_m, shape, class_id=0):
    """Frames of the shape (frames, bins, height, width) whose pixels all see a class, in the bin of
    a depth."""
    frames, bins, *pixels = shape
    seen_bin = int(place_of(torch.tensor(depth_m), bins))
    depth = torch.where(torch.arange(bins + 1) == seen_bin, 1e4, -1e4)
    classes = torch.where(torch.arange(NUM_CLASSES) == class_id, 1e4, -1e4)
    return Sight(*(x[None, :, None, None].repeat(frames, 1, *pixels) for x in (classes, depth)))
