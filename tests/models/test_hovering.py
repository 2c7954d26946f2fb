"""The shipped weights in a UAV that hovers: past images say nothing, so the current one must do."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from src.data.clip import poses_of
from src.geometry import quat_from_euler
from src.metrics import OccupancyScores
from src.models.checkpoint import Checkpoint
from src.models.frame import StreamFrame
from src.models.stream import SkyOccStream
from src.parallax import Parallax
from src.sim.clip_maker import ClipMaker
from src.sim.plan import plan_clips
from tests.synthetic import compose_config


class Hovering(ClipMaker):
    def stage(self, plan):
        """A UAV that stays where it starts but for 1 cm, and level but for 0.3 degrees."""
        flight, scene = super().stage(plan)
        rng, steps = np.random.default_rng(0), len(flight.time_s)
        place_m = flight.position_m[0] + rng.normal(0, 0.01, (steps, 3))
        roll, pitch, yaw = rng.normal(0, np.radians(0.3), (3, steps))
        quat_xyzw = quat_from_euler(roll, pitch, yaw + flight.yaw_rad[0])
        return replace(flight, position_m=place_m, quat_xyzw=quat_xyzw), scene


class WithoutPast(Parallax):
    def volume(self, images, *motion):
        return super().volume(images[-1:], *motion)


@pytest.mark.slow
def test_a_hovering_uav_is_served_as_well_as_by_the_current_image_alone():
    cfg = compose_config("task=look")
    network = Checkpoint.read(cfg.ckpt_path).network()
    assert network.parallax is not None, f"{cfg.ckpt_path} compares no frames"
    sim, images = OmegaConf.to_container(cfg.sim, resolve=True), []
    maker = Hovering(sim, None)
    seen = maker.observe(plan_clips(sim)[0], lambda frame, image, rendering: images.append(image))

    poses, last = poses_of(seen.recording.frames), range(30, 60)
    labels = [torch.from_numpy(maker.label(seen, n).semantics)[None] for n in last]

    scores = {}
    for parallax in (network.parallax, WithoutPast(**network.parallax.settings)):
        stream, metric = SkyOccStream(network, cfg.data.history_step_s), OccupancyScores(maker.grid)
        stream.parallax, still = parallax, torch.zeros(3)
        for n, target in zip(last, labels):
            taken = images[n].transpose(2, 0, 1), n / sim["capture_hz"], poses[n], still
            logits = stream(StreamFrame(*taken, maker.pix_from_camera, maker.body_from_camera))
            metric.update(logits[None], target, velocity=still[None])
        scores[type(parallax)] = float(metric.compute()["kar_miou"])
    assert scores[Parallax] == pytest.approx(scores[WithoutPast], abs=0.01)
