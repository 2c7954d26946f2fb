"""A clip of ours, written as other simulators would have recorded it."""

import json

import numpy as np
import pandas as pd
import torch
from PIL import Image

from src.geometry import euler_from_rotation, front_mount, inverse, quat_from_euler
from src.ontology import UNKNOWN
from src.recordings.carla import POINT
from src.recordings.flight import ActorTrack, Camera, RecordedFlight
from src.sim.annotation import FrontView

F = np.diag([1.0, -1.0, -1.0, 1.0])  # north, east, down
M = np.diag([1.0, -1.0, 1.0, 1.0])  # left-handed
CARLA_TAGS = {0: 3, 1: 1, 2: 9, 3: 6, 4: 15, 5: 14, 6: 12, 7: 20, UNKNOWN: 11}
AIRSIM_IDS = {**{k: k + 1 for k in range(8)}, UNKNOWN: 9}
NAMES = ["House", "Road", "OakTree", "SM_Pole", "Truck", "Car", "Person", "Bench", "SkySphere"]
PALETTE = [(40 * k % 256, 90 + k, 255 - 7 * k) for k in range(12)]


class Direct(RecordedFlight):
    """The clip itself; with ``from_camera`` the body is the camera, as where no mount is known."""

    def __init__(self, clip, from_camera=False):
        meta = clip.meta
        poses, mount = clip.world_from_body, meta.body_from_camera
        if from_camera:
            mount = front_mount((0.0, 0.0, 0.0))
            poses = poses @ meta.body_from_camera @ inverse(mount)
        camera = Camera(meta.pix_from_camera, mount, (meta.width, meta.height))
        time_s = clip.frames["time_s"].to_numpy()
        super().__init__("direct", clip.folder, time_s, poses, camera, tracks=tracks_of(clip))
        self.clip = clip

    def image(self, frame):
        return self.clip.image(frame)

    def depth_m(self, frame):
        return self.clip.aux("depth", frame)

    def class_id(self, frame):
        return self.clip.aux("class", frame)

    def actor_id(self, frame):
        return self.clip.aux("instance", frame)


def tracks_of(clip):
    tracks = []
    for actor_id, rows in clip.actors.groupby("actor_id"):
        first = rows.iloc[0]
        size_m = tuple(first[["length_m", "width_m", "height_m"]].astype(float))
        places = rows[["x_m", "y_m", "z_m"]].to_numpy(np.float64), rows["yaw_rad"].to_numpy()
        tracks.append(ActorTrack(actor_id, first["type"], int(first["class_id"]), size_m, *places))
    return tracks


def quats(poses):
    return quat_from_euler(*euler_from_rotation(torch.as_tensor(poses)[:, :3, :3])).numpy()


def save(folder, name, array):
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(array).save(folder / name)


def looked_up(table, image):
    values = np.zeros(256, dtype=np.uint8)
    for ours, theirs in table.items():
        values[ours] = theirs
    return values[image]


def write_plain(clip, folder, depth="axis"):
    meta, names = clip.meta, [f"{frame:06d}" for frame in range(len(clip))]
    (folder / "depth").mkdir(parents=True)
    for frame, name in enumerate(names):
        save(folder / "rgb", f"{name}.png", clip.image(frame))
        save(folder / "class", f"{name}.png", clip.aux("class", frame))
        ids = clip.aux("instance", frame)
        save(folder / "instance", f"{name}.png", np.maximum(ids, 0).astype(np.uint16))
        np.save(folder / "depth" / f"{name}.npy", clip.aux("depth", frame))
    clip.frames[["time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]].to_csv(
        folder / "poses.csv", index=False
    )
    columns = ["frame", "actor_id", "type", "class_id", "x_m", "y_m", "z_m", "yaw_rad"]
    clip.actors[[*columns, "length_m", "width_m", "height_m"]].to_csv(
        folder / "actors.csv", index=False
    )
    told = {"pix_from_camera": meta.pix_from_camera.tolist()}
    told["position_m"] = meta.body_from_camera[:3, 3].tolist()
    (folder / "camera.json").write_text(json.dumps(told))


def write_tartanair(clip, folder):
    poses = F @ Direct(clip, from_camera=True).world_from_body.numpy() @ F
    np.savetxt(folder_of(folder) / "pose_lcam_front.txt", np.c_[poses[:, :3, 3], quats(poses)])
    for frame in range(len(clip)):
        stem = f"{frame:06d}_lcam_front"
        depth = clip.aux("depth", frame)
        depth = np.where(np.isinf(depth), 1e4, depth).astype("<f4")
        # OpenCV, which writes theirs, takes the four bytes for blue, green, red and alpha.
        bgra = np.ascontiguousarray(depth).view(np.uint8).reshape(*depth.shape, 4)
        ids = looked_up(
            {**{k: 10 * k + 5 for k in range(8)}, UNKNOWN: 200}, clip.aux("class", frame)
        )
        save(folder / "image_lcam_front", f"{stem}.png", clip.image(frame))
        save(folder / "depth_lcam_front", f"{stem}_depth.png", bgra[..., [2, 1, 0, 3]])
        save(folder / "seg_lcam_front", f"{stem}_seg.png", ids)
    names = {name: 10 * k + 5 for k, name in enumerate(NAMES[:8])} | {NAMES[8]: 200}
    (folder / "seg_label_map.json").write_text(json.dumps({"name_map": names}))


def write_carla(clip, folder, boxes=True):
    folder_of(folder)
    poses = M @ Direct(clip, from_camera=True).world_from_body.numpy() @ M
    frames = []
    for frame, pose in enumerate(poses):
        depth = np.minimum(clip.aux("depth", frame).astype(np.float64), 1000.0)
        packed = np.round(depth / 1000 * (2**24 - 1)).astype(np.int64)
        bytes_of = np.stack([packed & 255, packed >> 8 & 255, packed >> 16], axis=-1)
        tags = looked_up(CARLA_TAGS, clip.aux("class", frame))
        black = np.zeros_like(tags)
        save(folder / "rgb", f"{frame:06d}.png", clip.image(frame))
        save(folder / "depth", f"{frame:06d}.png", bytes_of.astype(np.uint8))
        save(folder / "semantic", f"{frame:06d}.png", np.stack([tags, black, black], axis=-1))
        actors = [
            carla_actor(row) for _, row in clip.actors[clip.actors["frame"] == frame].iterrows()
        ]
        told = {"time_s": frame / clip.meta.capture_hz, "camera": carla_transform(pose)}
        frames.append(told | ({"actors": actors} if boxes else {}))
    hfov = 2 * np.degrees(np.arctan(clip.meta.width / 2 / clip.meta.pix_from_camera[0, 0].item()))
    told = {"version": "0.9.15", "fov_deg": hfov, "frames": frames}
    (folder / "frames.json").write_text(json.dumps(told))


def carla_transform(pose):
    """What CARLA's API would tell of a left-handed pose: its own Euler angles, in degrees."""
    # As carla.Transform.get_matrix() has it: pitch is nose up, and the right side's height is
    # -cos(pitch) sin(roll).
    forward, right, up = pose[:3, :3].T
    yaw, pitch = np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1, 1))
    roll = np.arctan2(-right[2], up[2])
    angles = np.degrees([roll, pitch, yaw])
    return dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), [*pose[:3, 3], *angles]))


def carla_actor(row):
    is_walker = row["type"] == "pedestrian"
    lift = row["height_m"] / 2 if is_walker else 0.0
    told = {"x": row["x_m"], "y": -row["y_m"], "z": row["z_m"] + lift, "roll": 0.0, "pitch": 0.0}
    extent = dict(zip("xyz", row[["length_m", "width_m", "height_m"]].astype(float) / 2))
    box = {"x": 0.0, "y": 0.0, "z": row["height_m"] / 2 - lift}
    told |= {"yaw": -np.degrees(row["yaw_rad"]), "extent": extent, "box": box}
    return {"id": int(row["actor_id"]), "type": row["type"], **told}


def write_airsim(clip, folder, kind=1):
    poses = F @ clip.world_from_body.numpy() @ F
    quat, rows = quats(poses), []
    for frame in range(len(clip)):
        names = {k: f"img_Drone_0_{k}_{1000 + frame}" for k in (0, kind, 5)}
        ids = looked_up(AIRSIM_IDS, clip.aux("class", frame))
        save(folder / "images", f"{names[0]}.png", clip.image(frame))
        save(folder / "images", f"{names[5]}.png", np.array(PALETTE, np.uint8)[ids])
        depth = np.where(np.isinf(clip.aux("depth", frame)), 65504.0, clip.aux("depth", frame))
        if kind == 2:
            meta = clip.meta
            u = np.arange(meta.width) + 0.5 - meta.pix_from_camera[0, 2].item()
            v = np.arange(meta.height) + 0.5 - meta.pix_from_camera[1, 2].item()
            focal = meta.pix_from_camera[0, 0].item()
            through = np.sqrt(1 + (u[None] / focal) ** 2 + (v[:, None] / focal) ** 2)
            depth = depth * through
        data = depth.astype("<f4").tobytes()
        header = f"Pf\n{clip.meta.width} {clip.meta.height}\n-1.0\n".encode()
        (folder / "images" / f"{names[kind]}.pfm").write_bytes(header + data)
        files = ";".join(f"{n}.{'pfm' if k == kind else 'png'}" for k, n in names.items())
        x, y, z, w = quat[frame]
        rows.append(
            ["Drone", 1000 * frame / clip.meta.capture_hz, *poses[frame, :3, 3], w, x, y, z]
        )
        rows[-1].append(files)
    columns = ["VehicleName", "TimeStamp", "POS_X", "POS_Y", "POS_Z", "Q_W", "Q_X", "Q_Y", "Q_Z"]
    pd.DataFrame(rows, columns=[*columns, "ImageFile"]).to_csv(
        folder / "airsim_rec.txt", sep="\t", index=False
    )
    (folder / "seg_rgbs.txt").write_text(
        "".join(f"{k}\t[{r}, {g}, {b}]\n" for k, (r, g, b) in enumerate(PALETTE))
    )


def folder_of(folder):
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def points_of(clip, frame):
    """What every fifth pixel with a class shows, in our world: what a LiDAR might have met."""
    flight = Direct(clip, from_camera=True)
    mount = flight.camera.body_from_camera, flight.camera.pix_from_camera
    images = flight.depth_m(frame), flight.class_id(frame), flight.actor_id(frame)
    rays = FrontView(flight.world_from_body[frame], *mount, *images).rays(5, np.inf)
    return rays.points_m(np.isfinite(rays.hits.distance_m))


def add_lidar(clip, folder):
    """Adds a level LiDAR at the camera, turned by 90 degrees, to what CARLA recorded."""
    flight = Direct(clip, from_camera=True)
    (folder / "lidar").mkdir()
    told = json.loads((folder / "frames.json").read_text())
    for frame, row in enumerate(told["frames"]):
        place_m = M[:3, :3] @ flight.world_from_body[frame, :3, 3].numpy()
        row["lidar"] = {**dict(zip("xyz", place_m)), "roll": 0.0, "pitch": 0.0, "yaw": 90.0}
        world = points_of(clip, frame) @ M[:3, :3] - place_m
        # The sensor's x is the world's y (left-handed), and its y the world's -x.
        local = np.stack([world[:, 1], -world[:, 0], world[:, 2]], axis=1)
        images = flight.depth_m(frame), flight.class_id(frame), flight.actor_id(frame)
        mount = flight.camera.body_from_camera, flight.camera.pix_from_camera
        hits = FrontView(flight.world_from_body[frame], *mount, *images).rays(5, np.inf).hits
        points = np.zeros(len(local), POINT)
        points["x"], points["y"], points["z"] = local.T
        points["tag"] = looked_up(CARLA_TAGS, hits.class_id[np.isfinite(hits.distance_m)])
        (folder / "lidar" / f"{frame:06d}.bin").write_bytes(points.tobytes())
    (folder / "frames.json").write_text(json.dumps(told))
