"""Hand-made scenes of a few boxes, and what a camera and LiDARs would sense of them."""

import numpy as np
import torch

from src.geometry import front_mount, pinhole, pixel_centers, rigid, rotation_from_euler, unproject
from src.ontology import CAR, GROUND
from src.sim.annotation import FrontView, label_frame
from src.sim.assets import upright
from src.sim.fusion import ActorMap, StaticMap
from src.sim.scene import Scene, SceneActor, count_by_actor, parts_of
from src.sim.sensors import scan
from src.sim.solid import Solid
from src.sim.world import World
from tests.sim.weathers import WEATHERS

WIDTH, HEIGHT = 96, 64
PIX_FROM_CAMERA = pinhole(WIDTH, HEIGHT, np.deg2rad(90))
BODY_FROM_CAMERA = front_mount((0.1, 0.0, -0.05))
RANGE_M = 60.0


def solid(class_id, size_m, center_m, shape="box", yaw_rad=0.0, material="asphalt"):
    size_m, scene_from_solid = tuple(map(float, size_m)), upright(*center_m, yaw_rad)
    return Solid(shape, class_id, size_m, scene_from_solid, material)


def ground(top_m=0.0, size_m=160.0):
    return solid(GROUND, (size_m, size_m, 1.0), (0, 0, top_m - 0.5))


def actor(places_m, size_m=(4.0, 2.0, 1.6), class_id=CAR, actor_id=1, yaw_rad=0.0):
    """A box that stands at one place after the other."""
    parts = parts_of([solid(class_id, size_m, (0, 0, size_m[2] / 2))])
    position_m = np.array(places_m, dtype=float)
    track = position_m, np.full(len(position_m), yaw_rad), np.zeros_like(position_m)
    return SceneActor(actor_id, "car", class_id, size_m, parts, *track)


def body_at(position_m, roll=0.0, pitch=0.0, yaw=0.0):
    """The transform world_from_body of a UAV at a place with an attitude."""
    angles = torch.tensor([roll, pitch, yaw], dtype=torch.float64)
    return rigid(rotation_from_euler(*angles), torch.tensor(position_m, dtype=torch.float64))


def camera_rays(world_from_body):
    """Origin and unit direction in the world of every pixel's ray, and its z-depth per metre."""
    pix = pixel_centers(WIDTH, HEIGHT).reshape(-1, 2)
    through = unproject(pix, torch.ones(len(pix), dtype=torch.float64), PIX_FROM_CAMERA)
    reach = through.norm(dim=-1, keepdim=True)
    world_from_camera = (world_from_body @ BODY_FROM_CAMERA).numpy()
    directions = (through / reach).numpy() @ world_from_camera[:3, :3].T
    origins_m = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
    return origins_m, directions, 1 / reach[:, 0].numpy()


def view_of(scene, step, world_from_body):
    """The images of a perfect renderer: every pixel is a ray cast."""
    origins_m, directions, depth_per_m = camera_rays(world_from_body)
    hits = scene.cast(step, origins_m, directions)
    depth_m = (hits.distance_m * depth_per_m).astype(np.float32)
    images = (image.reshape(HEIGHT, WIDTH) for image in (depth_m, hits.class_id, hits.actor_id))
    return FrontView(world_from_body, BODY_FROM_CAMERA, PIX_FROM_CAMERA, *images)


def places_of(view, here):
    """What every pixel of a view or a rendering shows, in the world; at the sky, the camera."""
    origins_m, directions, depth_per_m = camera_rays(here)
    distance_m = np.where(np.isinf(view.depth_m), 0, view.depth_m).reshape(-1) / depth_per_m
    return (origins_m + directions * distance_m[:, None]).reshape(HEIGHT, WIDTH, 3)


def world_of(scene, renderer="tiny"):
    return World(scene, PIX_FROM_CAMERA, WIDTH, HEIGHT, renderer)


def render(world, world_from_body, step=0, weather=WEATHERS["clear"]):
    return world.render(step, world_from_body @ BODY_FROM_CAMERA, weather)


class Stage:
    """A scene, the maps fused of it so far, and its labels."""

    def __init__(self, grid, static=(), bodies=(), lower_m=(-20, -40, -22), upper_m=(70, 40, 40)):
        self.grid = grid
        self.scene = Scene(parts_of(static), tuple(bodies))
        self.static = StaticMap(lower_m, upper_m, grid.voxel_m / 2)
        self.actors = ActorMap()

    def sense(self, step, world_from_body, rays=4000):
        """Fuses a scan of both LiDARs; returns how often each actor was met."""
        scans = scan(self.scene, step, world_from_body.numpy(), rays, step, RANGE_M)
        for each in scans:
            self.static.add(each, RANGE_M)
            self.actors.add(each, self.scene.actors, step)
        return count_by_actor(np.concatenate([each.hits.actor_id for each in scans]))

    def freeze(self):
        self.static.freeze()
        self.actors.freeze()

    def label(self, step, world_from_body, returns, view=None):
        view = view or view_of(self.scene, step, world_from_body)
        maps = self.static, self.actors
        return label_frame(view, self.grid, *maps, self.scene.actors, step, returns)
