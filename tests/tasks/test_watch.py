"""task=watch: a flight filmed by another camera is seen as by the network's own."""

import math
import re
import sys
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
import torch
from hydra.utils import instantiate
from PIL import Image

import src.tasks.watch as watch_module
from src.data.clip import Clip, poses_of
from src.data.predictions import Predictions
from src.geometry import front_mount, pinhole
from src.lens import Lens
from src.metrics import OccupancyScores
from src.models.stream import SkyOccStream, StreamFrame
from src.tasks.dataset import ready_dataset
from tests.sessions import ROOT
from tests.synthetic import compose_config, flight, meta_of, render

HFOV, SIZE = 110, (240, 160)
MOUNT = "task.camera.position_m=[0.1,0.0,-0.05]"
COLUMNS = ["time_s", "x_m", "y_m", "height_m", "roll_rad", "pitch_rad", "yaw_rad"]


def write_flight(folder, frames=6, name="flight.mp4", hfov_deg=HFOV):
    """A flight filmed with a wider camera, as a video and as images; its poses, and what the
    network's own camera would have filmed."""
    table = flight(2.5).head(frames).assign(height_m=lambda each: each.z_m)
    table[COLUMNS].to_csv(folder / "flight.csv", index=False)
    own = meta_of("downtown", 2.5, 96, 64)
    wide = replace(
        meta_of("downtown", 2.5, *SIZE), pix_from_camera=pinhole(*SIZE, math.radians(hfov_deg))
    )
    writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*"mp4v"), 2.5, SIZE)
    (folder / "images").mkdir()
    images = []
    for time_s, world_from_body in zip(table.time_s, poses_of(table)):
        filmed = render(world_from_body, wide)[0]
        writer.write(np.ascontiguousarray(filmed[..., ::-1]))
        Image.fromarray(filmed).save(folder / f"images/{time_s:07.3f}.png")
        images.append(render(world_from_body, own)[0])
    writer.release()
    return table, images


@pytest.fixture
def watching(run_py, checkpoint, tmp_path, monkeypatch):
    """Runs the command in a folder with a flight; returns its output and what the stream got."""
    frames = []

    class Watched(SkyOccStream):
        def __call__(self, frame):
            frames.append((frame, [past.frame for past in self._still_valid(frame)]))
            return super().__call__(frame)

    monkeypatch.setattr(watch_module, "SkyOccStream", Watched)
    monkeypatch.chdir(tmp_path)

    def called(*words):
        frames.clear()
        here = (f"ckpt_path={checkpoint}", f"paths.runs={tmp_path}/runs", "task.predict_hz=2.5")
        cpu = ("trainer.accelerator=cpu", "threads=1", MOUNT)
        status, out, errors = run_py("task=watch", *here, *cpu, *words)
        return status, "\n".join(out + errors), frames

    return called


VIDEO = ("video=flight.mp4", "poses=flight.csv", f"task.camera.hfov_deg={HFOV}")
FOLDER = ("video=images", *VIDEO[1:])


def difference(frame, own):
    """The mean difference of grey between an image of the stream and the own camera's."""
    return np.abs(frame.image.permute(1, 2, 0).numpy().astype(int) - own).mean()


@pytest.mark.parametrize("words", [VIDEO, FOLDER])
def test_the_network_sees_what_its_own_camera_would(watching, tmp_path, words):
    table, images = write_flight(tmp_path)
    status, output, frames = watching(*words)
    assert status == 0, output
    assert len(frames) == 6
    for (frame, _), own, world_from_body in zip(frames, images, poses_of(table)):
        assert difference(frame, own) < 6  # of 255; edges are softer
        assert np.abs(frame.world_from_body - world_from_body.numpy()).max() < 1e-6
        assert frame.body_from_camera.equal(front_mount((0.1, 0.0, -0.05)))
        assert (
            np.abs(frame.velocity_mps - [2, 0.3 * math.cos(0.3 * frame.time_s), 0.1]).max() < 0.02
        )
    assert "velocities are the derivative" in output

    narrow = watching(*words[:2], "task.camera.hfov_deg=60")[2]
    assert min(difference(frame, own) for (frame, _), own in zip(narrow, images)) > 15


def test_it_leaves_labels_a_film_and_a_recording(watching, tmp_path):
    write_flight(tmp_path)
    status, output, frames = watching(*FOLDER)
    assert status == 0, output
    folder = tmp_path / "runs/watch/images"
    assert f"{folder}: labels of 6 frames, watch.gif, watch.mcap" in output
    with Image.open(folder / "watch.gif") as film:
        assert film.n_frames == 6
        assert film.info["duration"] == 400
    assert (folder / "watch.mcap").stat().st_size > 1000

    predictions = Predictions(folder / "predictions")
    assert predictions.facts["times_s"] == pytest.approx([0.4 * n for n in range(6)])
    stream = watch_module.SkyOccStream.of(predictions.facts["checkpoint"])
    for n, (frame, _) in enumerate([*frames]):
        expected = stream(frame).argmax(dim=0)
        assert predictions.labels("images", n).equal(expected.to(torch.uint8))

    # Another look takes the place of the first one, and nothing else is ever replaced.
    assert watching(*FOLDER, "task.seconds=1")[0] == 0
    assert len(Predictions(folder / "predictions").facts["times_s"]) == 3
    (tmp_path / "mine/images").mkdir(parents=True)
    status, output, _ = watching(*FOLDER, "task.out=mine")
    assert status == 2
    assert "mine/images: exists and is not of task=watch" in output


def test_without_a_motion_every_image_is_alone_and_it_is_said(watching, tmp_path):
    table, _ = write_flight(tmp_path)
    _, output, with_motion = watching(*FOLDER)
    assert [bool(past) for _, past in with_motion] == [False] + [True] * 5
    table[["time_s", "height_m", *COLUMNS[4:]]].to_csv("flight.csv", index=False)
    status, output, frames = watching(*FOLDER, "task.speed_mps=5")
    assert status == 0
    assert all(past == [] for _, past in frames)
    assert re.search("neither positions nor velocities.*by itself.* 5 m/s along the yaw", output)
    for frame, _ in frames:
        ahead = frame.world_from_body[:2, 0] / np.linalg.norm(frame.world_from_body[:2, 0])
        assert frame.velocity_mps == pytest.approx([*5 * ahead, 0], abs=1e-9)


def test_a_stream_without_a_past_makes_no_cost_volume(checkpoint, unchecked):
    """What the command relies on where no motion is known: another clip is another flight."""
    stream, camera = SkyOccStream.of(checkpoint), pinhole(96, 64, math.radians(90))
    image = torch.randint(0, 256, (3, 64, 96), dtype=torch.uint8)
    for n, clip in enumerate(("a", "a", "b")):
        pose = torch.eye(4, dtype=torch.float64)
        pose[:3, 3] = torch.tensor([2.0 * n, 0, 6])
        mount = front_mount((0.0, 0, 0))
        frame = StreamFrame(image, 0.4 * n, pose, torch.zeros(3), camera, mount, clip)
        batch, history = stream.arguments(frame)
        assert bool(history.valid.any()) == bool(batch["parallax"].any()) == (n == 1)
        stream(frame)


def test_without_its_library_there_is_no_mcap_and_it_is_said(watching, tmp_path, monkeypatch):
    write_flight(tmp_path)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    status, output, _ = watching(*FOLDER, "task.seconds=0.5")
    assert status == 0
    assert "without watch.mcap: needs foxglove; pip install -e '.[view]'" in output
    assert not (tmp_path / "runs/watch/images/watch.mcap").exists()


def test_names_in_the_poses_are_times_too(watching, tmp_path):
    table, _ = write_flight(tmp_path)
    (tmp_path / "shots").mkdir()
    names = ["", "b.png", "", "a.png", "", ""]
    for name, time_s in zip(names, table.time_s):
        if name:
            (tmp_path / f"images/{time_s:07.3f}.png").rename(tmp_path / "shots" / name)
    table[COLUMNS].assign(image=names).to_csv("flight.csv", index=False)
    status, output, frames = watching("video=shots", *FOLDER[1:])
    assert status == 0, output
    assert [frame.time_s for frame, _ in frames] == pytest.approx([0.4, 1.2])


def test_a_calibration_of_opencv_is_half_a_pixel_off_ours():
    camera = {"hfov_deg": None, "fx": 100.0, "fy": 101.0, "cx": 119.5, "cy": 79.5}
    lens = watch_module._lens({**camera, "distortion": [0.1]}, SIZE)
    assert lens == Lens((100.0, 101.0), (120.0, 80.0), (0.1,))
    of_width = watch_module._lens({**dict.fromkeys(camera), "hfov_deg": 90, "distortion": []}, SIZE)
    assert of_width.center_pix == lens.center_pix
    assert of_width.focal_pix == pytest.approx((120, 120))


def test_a_part_of_the_view_that_is_black_is_said(watching, tmp_path):
    write_flight(tmp_path, hfov_deg=60)
    output = watching(*VIDEO[:2], "task.camera.hfov_deg=60", "task.seconds=0.5")[1]
    assert re.search(r"does not see 6\d% of the network's view", output)


# What is typed, and what the refusal says.
REFUSED = {
    "video=null": "video: task=watch needs",
    "poses=null": "poses: task=watch needs",
    "video=none.mp4": r"none\.mp4 is not there",
    "poses=none.csv": r"none\.csv cannot be read",
    "task.start_s=0.1": r"flight\.mp4 has images from 0\.100 to 2\.100 s, and .*0\.000 to 2\.000",
    "task.camera.hfov_deg=null": "task.camera: give hfov_deg, or else all of fx",
    "task.camera.fx=100": "task.camera: give hfov_deg, or else all of fx",
    "task.camera.hfov_deg=200": "task.camera.hfov_deg: 200",
    "task.camera.distortion=[0,0,0,0,0,0,0,1]": "distortion: 8 numbers",
    "task.camera.hfov_deg=null task.camera.fx=100 task.camera.fy=100 task.camera.cx=480 "
    "task.camera.cy=80": "cx=480, cy=80 is far from the middle of 240x160",
    "task.predict_hz=0": "task.predict_hz: 0",
    "video=images task.start_s=1": "task.start_s: these images have times of their own",
    "task.camera.distortion=[a]": "task.camera.distortion: .*give numbers",
    "task.camera.position_m=[0.1]": "three numbers: forward, left and up",
    "task.poses_convention=frd": "task.poses_convention: 'frd'; there are enu, ned",
    "ckpt_path=none.ckpt": "ckpt_path: no checkpoint none.ckpt",
    "task.cam=1": "task.cam",
}


def test_what_cannot_be_is_refused_before_anything_is_written(watching, tmp_path):
    write_flight(tmp_path)
    for words, told in REFUSED.items():
        status, output, frames = watching(*VIDEO, *words.split())
        assert status != 0, words
        assert re.search(told, output), (words, output)
        assert frames == []
        assert not (tmp_path / "runs").exists()


def test_a_flight_above_what_the_network_knows_is_refused(watching, tmp_path):
    table, _ = write_flight(tmp_path)
    table.assign(height_m=90.0)[COLUMNS].to_csv("flight.csv", index=False)
    status, output, _ = watching(*VIDEO)
    assert status == 2
    assert re.search("poses: height_m: z is 90 m, and this network flies", output)


def test_frames_that_are_flown_higher_than_any_in_training_are_told(watching, tmp_path):
    table, _ = write_flight(tmp_path)
    heights_m = np.where(np.arange(len(table)) < 2, 20.5, 19.5)
    table.assign(height_m=heights_m)[COLUMNS].to_csv("flight.csv", index=False)
    status, output, _ = watching(*VIDEO)
    assert status == 0, output
    assert "2 of the frames are more than 20 m above the ground" in output


def test_the_recipe_of_the_page_works(watching, tmp_path):
    section = (ROOT / "docs/own_data.md").read_text().partition("## My drone's video")[2]
    (recipe,) = re.findall(r"```bash\n(.*?)```", section.partition("\n## ")[0], re.DOTALL)
    command = recipe.strip().removeprefix("python run.py task=watch ").split()
    hfov_deg = float(command[-1].rpartition("=")[2])
    write_flight(tmp_path, hfov_deg=hfov_deg)
    status, output, frames = watching(*command)
    assert status == 0, output
    assert len(frames) == 6
    columns = {
        *re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)))
    }
    assert {*COLUMNS, "image", "qw", "vx_mps"} <= columns


@pytest.mark.slow
def test_a_wider_camera_scores_as_the_clip_itself_and_a_wrong_one_does_not(
    tmp_path, unchecked, monkeypatch
):
    """One flight of the generator, filmed twice; the labels are those of the first film."""
    monkeypatch.setattr(watch_module._Watcher, "_draw", lambda *_: None)  # films take minutes
    words = ("task=generate", "sim.towns=[downtown]", "sim.weathers=[clear]", "sim.seed=1")
    words += ("sim.clips_per_town=1", "data.test_clips=[]", "data.val_clips=[]", "sim.workers=1")
    words += ("sim.save_aux=false", "model/sight=off", "model/evidence=off", "model/parallax=off")
    wider = ("sim.image.width=448", "sim.image.height=256", "sim.image.hfov_deg=110")
    own, wide = (
        Clip(
            ready_dataset(compose_config(*words, *more, f"paths.data={tmp_path}/{name}"))
            / "downtown/clip00"
        )
        for name, more in (("own", ()), ("wide", wider))
    )
    assert pd.DataFrame.equals(own.frames, wide.frames)
    (tmp_path / "film").mkdir()
    for n, time_s in enumerate(wide.frames.time_s):
        Image.fromarray(wide.image(n)).save(tmp_path / f"film/{time_s:07.3f}.png")
    poses = wide.frames.drop(columns="altitude_m").rename(columns={"z_m": "height_m"})
    poses.to_csv(tmp_path / "film.csv", index=False)

    def score(labels):
        scores = OccupancyScores(own.meta.grid)
        for n in range(len(own)):
            velocity = torch.from_numpy(
                own.frames.loc[[n], ["vx_mps", "vy_mps", "vz_mps"]].to_numpy()
            )
            scores.update(labels(n)[None], torch.tensor(own.semantics(n))[None], velocity=velocity)
        return 100 * float(scores.compute()["kar_miou"])

    def watched(hfov_deg):
        out = tmp_path / f"watched{hfov_deg}"
        cfg = compose_config(
            *("task=watch", f"task.out={out}", f"task.camera.hfov_deg={hfov_deg}", MOUNT),
            *("trainer.accelerator=cpu", f"video={tmp_path}/film", f"poses={tmp_path}/film.csv"),
        )
        instantiate(cfg.task)(cfg)
        predictions = Predictions(out / "film/predictions")
        return score(lambda n: predictions.labels("film", n))

    stream = SkyOccStream.of(ROOT / compose_config("task=watch").ckpt_path)
    motion = own.frames[["vx_mps", "vy_mps", "vz_mps"]].to_numpy()

    def direct(n):
        image = own.image(n).transpose(2, 0, 1)
        camera = own.meta.pix_from_camera, own.meta.body_from_camera
        frame = StreamFrame(image, own.frames.time_s[n], own.world_from_body[n], motion[n], *camera)
        return stream(frame).argmax(dim=0).to(torch.uint8)

    itself = score(direct)
    assert itself > 15
    assert watched(110) == pytest.approx(itself, abs=2)
    assert watched(80) < itself - 5
