"""Clips of a scene that is known in closed form: ground and two boxes, seen by a swaying UAV.

They have the format, the geometry and the labels of generated ones, and need no simulator.
"""

import math
import pickle
from functools import cache
from pathlib import Path

import pandas as pd
import torch
from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf, open_dict

from src.data.clip import ACTOR_COLUMNS, CLIP_SECONDS, ClipMeta, ClipWriter, poses_of
from src.data.manifest import write_manifest
from src.data.split import make_split
from src.geometry import (
    VoxelGrid,
    camera_from_occ,
    front_mount,
    in_image,
    pinhole,
    pixel_centers,
    project,
    quat_from_euler,
    transform,
    unproject,
    world_from_occ,
)
from src.ontology import CLASSES, FREE, SKY, UNKNOWN
from src.run_folder import RunFolder
from src.settings import add_named_weathers, require_sound
from src.tasks.dataset import root_of, spec_of
from src.tasks.model import module_of, network_of, origin_of

CONF = Path(__file__).parent.parent / "conf"
BOXES = (  # lower and upper corner in the world (m), class, color
    ((12.0, 4.0, 0.0), (24.0, 14.0, 9.0), "building", (200, 60, 40)),
    ((30.0, -12.0, 0.0), (38.0, -5.0, 5.0), "vegetation", (30, 160, 50)),
)
GROUND_RGB, SKY_RGB = (120, 120, 130), (150, 200, 250)
MINI = (
    *("scale=tiny", "sim.towns=[downtown,suburb]", "sim.clips_per_town=1", "sim.capture_hz=2.5"),
    *("data.test_clips=[suburb/clip00]", "data.history_step_s=0.4", "data.workers=0", "threads=1"),
    "data.parallax.ages_s=[0.4,0.8]",
    *("trainer.log_every_n_steps=1", "trainer.precision=32-true", "suite.resamples=20"),
    "callbacks.preview.frames=1",
)
"""Two clips of 30 frames: training takes three steps an epoch, with the same bits everywhere."""
GENERATED = (
    *("scale=tiny", "scale_name=mini", "sim.towns=[suburb]", "sim.weathers=[clear,rain]"),
    *("sim.capture_hz=2.5", "sim.lidar_hz=2.5", "sim.lidar_rays=4000", "sim.save_aux=true"),
)
"""Two clips of 30 frames, too, of which the generator makes all that it can make."""


@cache
def _composed(*options):
    """The composition of options, in bytes: each test loads a copy of its own."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return pickle.dumps(compose("config", list(options), return_hydra_config=True))


def _config(overrides, composed=_composed, where=()):
    """What Hydra composes, its own part included; the options of a command only once a session."""
    words = OverridesParser.create().parse_overrides(list(overrides))
    options = [word for word in words if (CONF / word.key_or_group).is_dir()]
    cfg = pickle.loads(composed(*(option.input_line for option in options), *where))
    values = [word for word in words if word not in options]
    ConfigLoaderImpl._apply_overrides_to_config(values, cfg)
    cfg.hydra.overrides.task = list(overrides)
    return cfg


def _without_hydra(cfg):
    with open_dict(cfg):
        del cfg.hydra
    return cfg


def compose_config(*overrides):
    """The configuration of a command line, without Hydra's application."""
    return _without_hydra(_config(overrides))


def sound_config(*overrides, folder=None):
    """The same, once it is found to be sound; ``folder`` holds files of the user's own."""
    if folder:  # whose files another test may have changed
        cfg = _config(overrides, _composed.__wrapped__, [f"hydra.searchpath=[file://{folder}]"])
    else:
        cfg = _config(overrides)
    with initialize_config_dir(str(CONF), version_base="1.3"):
        require_sound(cfg, cfg.hydra)
        add_named_weathers(cfg, cfg.hydra)
    return _without_hydra(cfg)


def mini_overrides(folder, *more):
    """The words that make every command small and keep it in a folder."""
    mini = [*MINI]
    if {"recipe=paper", "model/parallax=off"} & {*more}:
        mini.remove("data.parallax.ages_s=[0.4,0.8]")
    return [*mini, f"paths.data={folder}/data", f"paths.runs={folder}/runs", *more]


def generated_config(folder, workers=1):
    """The configuration of the small generated dataset, in a folder."""
    return compose_config(*GENERATED, f"paths.data={folder}", f"sim.workers={workers}")


def untrained(cfg, data):
    """The module of a training that would begin now."""
    config = OmegaConf.to_container(cfg, resolve=True)
    origin = origin_of(cfg, data, RunFolder(cfg.paths.run, config, data.root.name))
    return module_of(cfg, data, network_of(cfg, origin), origin)


def write_dataset(cfg):
    """A finished dataset where the configuration expects one, made of synthetic clips."""
    root, sim = root_of(cfg), cfg.sim
    clip_ids = [f"{town}/clip{i:02d}" for town in sim.towns for i in range(sim.clips_per_town)]
    grid = VoxelGrid(**OmegaConf.to_container(cfg.grid))
    for seed, clip_id in enumerate(clip_ids):
        write_clip(root / clip_id, sim.capture_hz, sim.image.width, sim.image.height, grid, seed)
    frames = round(CLIP_SECONDS * sim.capture_hz)
    split = make_split(clip_ids, frames, sim.capture_hz, cfg.data.val_clips, cfg.data.test_clips)
    write_manifest(root, spec_of(cfg), clip_ids, split)
    return root


def write_clip(folder, capture_hz=2.5, width=96, height=64, grid=None, seed=0):
    """Writes one clip; another seed flies another way through the same scene."""
    meta = meta_of(folder.parent.name, capture_hz, width, height, grid, seed)
    frames = flight(capture_hz, seed)
    poses = poses_of(frames)
    with ClipWriter(folder, meta) as writer:
        for frame, world_from_body in enumerate(poses):
            image, depth_m, class_id = render(world_from_body, meta)
            writer.add_image(frame, image)
            writer.add_aux(frame, depth=depth_m, **{"class": class_id})
            semantics = labels_of(world_from_body, meta)
            writer.add_labels(frame, semantics.numpy(), (semantics != UNKNOWN).numpy())
        writer.add_tables(frames, pd.DataFrame(columns=ACTOR_COLUMNS))


def meta_of(town, capture_hz, width, height, grid=None, seed=0):
    """What holds for a whole clip of a level camera in fair weather."""
    return ClipMeta(
        town=town,
        weather="clear",
        seed=seed,
        capture_hz=capture_hz,
        width=width,
        height=height,
        pix_from_camera=pinhole(width, height, math.radians(90)),
        body_from_camera=front_mount((0.1, 0.0, -0.05)),
        grid=grid or VoxelGrid(shape=(25, 25, 15)),
    )


def flight(capture_hz, seed=0):
    """``frames.csv``: forward at about 2 m/s, turning and swaying."""
    time_s = torch.arange(round(CLIP_SECONDS * capture_hz), dtype=torch.float64) / capture_hz
    phase = time_s + 1.7 * seed
    roll, pitch = 0.2 * torch.sin(1.3 * phase), 0.1 * torch.cos(0.9 * phase)
    yaw = 0.25 * torch.sin(0.4 * phase)
    zero = torch.zeros_like(time_s)
    columns = {
        "time_s": time_s,
        **{"x_m": 2 * time_s, "y_m": torch.sin(0.3 * phase), "z_m": 6.3 + 0.1 * phase},
        **dict(zip(("qx", "qy", "qz", "qw"), quat_from_euler(roll, pitch, yaw).T)),
        **{"vx_mps": 2 + zero, "vy_mps": 0.3 * torch.cos(0.3 * phase), "vz_mps": 0.1 + zero},
        **dict.fromkeys(("wx_radps", "wy_radps", "wz_radps"), zero),
        **{"roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw, "altitude_m": 6.3 + 0.1 * phase},
    }
    table = pd.DataFrame({name: value.numpy() for name, value in columns.items()})
    return table.assign(frame=range(len(table)))


def class_at(points_world):
    """Class of every point (uint8): what the labels must say there."""
    semantics = torch.full(points_world.shape[:-1], FREE, dtype=torch.uint8)
    semantics[points_world[..., 2] < 0] = CLASSES.index("ground")
    for lower, upper, name, _ in BOXES:
        lower, upper = points_world.new_tensor(lower), points_world.new_tensor(upper)
        inside = ((points_world >= lower) & (points_world < upper)).all(dim=-1)
        semantics[inside] = CLASSES.index(name)
    return semantics


def labels_of(world_from_body, meta):
    """Labels of the voxels whose center is in the image; the rest is unknown."""
    centers = meta.grid.centers(torch.float64).flatten(0, 2)
    semantics = class_at(transform(world_from_occ(world_from_body), centers))
    chain = camera_from_occ(world_from_body, meta.body_from_camera)
    seen = in_image(*project(centers, chain, meta.pix_from_camera), meta.width, meta.height)
    return semantics.masked_fill(~seen, UNKNOWN).view(meta.grid.shape)


def render(world_from_body, meta):
    """The image, every pixel's nearest surface in its color; the depth in metres; the classes."""
    pix = pixel_centers(meta.width, meta.height).flatten(0, 1)
    ones = torch.ones(len(pix), dtype=torch.float64)
    world_from_camera = world_from_body @ meta.body_from_camera
    direction = unproject(pix, ones, meta.pix_from_camera) @ world_from_camera[:3, :3].T
    origin = world_from_camera[:3, 3]
    nearest = -origin[2] / direction[:, 2]
    nearest[nearest < 0] = torch.inf
    image = torch.tensor(SKY_RGB, dtype=torch.uint8).repeat(len(pix), 1)
    image[nearest.isfinite()] = torch.tensor(GROUND_RGB, dtype=torch.uint8)
    class_id = torch.where(nearest.isfinite(), CLASSES.index("ground"), SKY).to(torch.uint8)
    for lower, upper, name, color in BOXES:
        corners = torch.tensor([lower, upper], dtype=torch.float64)
        crossings = (corners[:, None] - origin) / direction
        enter, leave = crossings.amin(0).amax(-1), crossings.amax(0).amin(-1)
        hit = (enter < leave) & (enter > 0) & (enter < nearest)
        image[hit] = torch.tensor(color, dtype=torch.uint8)
        class_id[hit] = CLASSES.index(name)
        nearest = torch.where(hit, enter, nearest)
    size = meta.height, meta.width
    depth_m, class_id = (each.view(size).numpy() for each in (nearest.float(), class_id))
    return image.view(*size, 3).numpy(), depth_m, class_id
