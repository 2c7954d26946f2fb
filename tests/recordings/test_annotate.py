"""One of our clips, recorded as others record, has the labels that our chain gives it directly."""

import json
import math
import shutil
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import torch
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from src.data.clip import Clip
from src.data.doubt import AS_RECORDED, doubt_of, shares_that_stay
from src.data.manifest import read_manifest
from src.data.pictures import files_of, read_rgb
from src.errors import UserError
from src.ontology import FREE, UNKNOWN
from src.recordings.annotate import Cut, clips_by_name, write_clips
from src.recordings.carla import matrix_of, tracks_of
from src.recordings.clip import RecordedClip, ground_of
from src.recordings.flight import require_frames
from src.recordings.plain import read_table
from src.sim.observation import Annotator
from tests.recordings import foreign
from tests.synthetic import compose_config

LAYOUTS = {
    "plain": (foreign.write_plain, False),
    "airsim": (foreign.write_airsim, False),
    "carla": (foreign.write_carla, True),
    "tartanair": (foreign.write_tartanair, True),
}
# The share of the labelled voxels that may differ: of depths in 24 bits, of boxes for instances,
# and of everything that moves taken to stand.
DIFFERING = {"plain": 0.0, "airsim": 0.02, "carla": 0.02, "tartanair": 0.05}


@pytest.fixture(scope="module")
def clip(mini_dataset):
    return Clip(mini_dataset / next(iter(read_manifest(mini_dataset)["clips"])))


def annotator(clip):
    return Annotator(clip.meta.grid, range_m=60.0, camera_stride=2, fused_hz=5.0)


def layout(name, **changes):
    settings = compose_config(f"layout={name}").layout
    settings = {key: each for key, each in settings.items() if key != "name"}
    try:
        return instantiate(OmegaConf.merge(settings, changes), _convert_="all")
    except InstantiationException as error:
        raise error.__cause__ from None


def labels_of(recording, how):
    seen = how.observe(recording)
    return np.stack([how.label(seen, frame).semantics for frame in range(len(seen.views))])


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_clip_recorded_elsewhere_has_the_labels_of_the_chain(clip, tmp_path, name):
    write, from_camera = LAYOUTS[name]
    write(clip, tmp_path / "flight")
    hz = clip.meta.capture_hz
    changes = {"airsim": {"position_m": clip.meta.body_from_camera[:3, 3].tolist()}}
    changes |= {"tartanair": {"rate_hz": hz}}
    [flight] = layout(name, **changes.get(name, {})).flights(tmp_path)
    static = name == "tartanair"

    direct = RecordedClip(foreign.Direct(clip, from_camera), 0, 1, hz, 0.0, static)
    theirs = RecordedClip(flight, 0, 1, hz, 0.0, static)
    wanted = labels_of(direct, annotator(clip))
    got = labels_of(theirs, annotator(clip))

    known = (wanted != UNKNOWN) | (got != UNKNOWN)
    share = (wanted != got)[known].mean()
    assert share <= DIFFERING[name]
    assert ((got < FREE).sum(axis=(1, 2, 3)) > 50).all()


def one_clip(flight, clip, static=False, ground_m=0.0):
    return RecordedClip(flight, 0, 1, clip.meta.capture_hz, ground_m, static)


def test_further_cameras_and_a_lidar_add_what_they_see(clip, tmp_path):
    """A second camera that looks where the first one does says the same; a LiDAR whose returns are
    the camera's own points adds no surface elsewhere."""
    alone, both = tmp_path / "alone/f", tmp_path / "both/f"
    for folder in (alone, both):
        foreign.write_tartanair(clip, folder)
    shutil.copy(both / "pose_lcam_front.txt", both / "pose_lcam_left.txt")
    for kind in ("depth", "seg"):
        shutil.copytree(both / f"{kind}_lcam_front", both / f"{kind}_lcam_left")
    [one], [two] = (
        layout("tartanair", rate_hz=clip.meta.capture_hz).flights(folder.parent)
        for folder in (alone, both)
    )
    assert [len(one.scans(0)), len(two.scans(0))] == [0, 1]
    wanted, got = (labels_of(one_clip(each, clip, True), annotator(clip)) for each in (one, two))
    assert (wanted != got).mean() < 0.001

    foreign.write_carla(clip, tmp_path / "carla/f")
    [bare] = layout("carla").flights(tmp_path / "carla")
    foreign.add_lidar(clip, tmp_path / "carla/f")
    [scanned] = layout("carla").flights(tmp_path / "carla")
    scan = scanned.scans(0)[0]
    points_m = scan.points_m(np.ones(len(scan.directions), bool))
    true_m = foreign.points_of(clip, 0)
    assert np.abs(points_m - true_m).max() < 0.01
    wanted, got = (labels_of(one_clip(each, clip), annotator(clip)) for each in (bare, scanned))
    assert (wanted != got).mean() < 0.002


def test_the_ground_of_a_recording_is_found_in_its_images(clip):
    flight = foreign.Direct(clip)
    found_m = ground_of(flight)
    assert abs(found_m) < 0.5
    flight.world_from_body = flight.world_from_body.clone()
    flight.world_from_body[:, 2, 3] += 120.0
    assert ground_of(flight) == pytest.approx(found_m + 120.0)
    # Its clips stand on the ground again.
    heights_m = one_clip(flight, clip, ground_m=120.0).frames["altitude_m"]
    assert heights_m.to_numpy() == pytest.approx(clip.frames["z_m"].to_numpy())


def test_velocities_and_rates_come_from_the_poses(clip):
    made = one_clip(foreign.Direct(clip), clip).frames
    for names, tolerance in (("vx_mps vy_mps vz_mps", 0.6), ("wx_radps wy_radps wz_radps", 0.4)):
        off = np.abs(made[names.split()].to_numpy() - clip.frames[names.split()].to_numpy())
        assert np.median(off) < tolerance / 4
        assert off[1:-1].max() < 3 * tolerance
    same = ["x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"]
    assert np.allclose(made[same], clip.frames[same], atol=1e-9)


# ------------------------------------------------------------------------------- wrong conventions


def written(clip, folder, change=None, depth=None, depth_is="axis", **settings):
    """The first clip of a plain recording with changed poses or depth, annotated."""
    foreign.write_plain(clip, folder / "flight")
    if change:
        path = folder / "flight/poses.csv"
        change(pd.read_csv(path)).to_csv(path, index=False)
    for path in (folder / "flight/depth").glob("*.npy") if depth else ():
        np.save(path, depth(np.load(path)))
    recording = layout("plain", depth=depth_is, **settings).flights(folder)
    made = RecordedClip(recording[0], 0, 1, clip.meta.capture_hz, 0.0, False)
    write_clips(folder / "made", {"flight/clip00": made}, annotator(clip), 1)
    return Clip(folder / "made/flight/clip00")


def reordered(table):
    quat = ["qx", "qy", "qz", "qw"]
    return table.assign(**dict(zip(quat, table[["qw", "qx", "qy", "qz"]].to_numpy().T)))


def turned_back(table):
    return table.assign(qx=-table.qx, qy=-table.qy, qz=-table.qz)


def in_centimetres(table):
    return table.assign(**{name: 100 * table[name] for name in ("x_m", "y_m", "z_m")})


def along_rays(clip, depth_m):
    places = np.indices(depth_m.shape)[::-1].transpose(1, 2, 0) + 0.5
    pix_from_camera = clip.meta.pix_from_camera.numpy()
    away = (places - pix_from_camera[:2, 2]) / pix_from_camera[0, 0]
    return (depth_m * np.sqrt(1 + (away**2).sum(-1))).astype(np.float32)


WRONG = {
    "left-handed": {"axes": "left_handed"},
    "north, east, down": {"axes": "north_east_down"},
    "columns": {"change": reordered},
    "world to the body": {"change": turned_back},
    "centimetres": {"change": in_centimetres},
    "along the ray": {},
}


def test_a_sound_recording_is_not_suspected(clip, tmp_path):
    shares = shares_that_stay(written(clip, tmp_path))
    assert shares[AS_RECORDED] == max(shares.values()) > 0.3
    assert doubt_of(shares) == ""
    # Of frames that do not belong together so few stay, and no convention mends it.
    assert "do images, depth and poses of one frame belong together" in doubt_of(
        dict.fromkeys(shares, 0.13)
    )


@pytest.mark.parametrize("suspect", WRONG)
def test_a_wrong_convention_is_told_by_its_name(clip, tmp_path, suspect):
    changes = dict(WRONG[suspect])
    if suspect == "along the ray":
        changes["depth"] = partial(along_rays, clip)
    wrong = written(clip, tmp_path, **changes)
    assert suspect in doubt_of(shares_that_stay(wrong))


def test_depth_along_the_ray_is_read_as_what_it_is(clip, tmp_path):
    made = written(clip, tmp_path, depth=partial(along_rays, clip), depth_is="ray")
    assert np.allclose(made.aux("depth", 0), clip.aux("depth", 0), rtol=1e-5)


# ------------------------------------------------------------------------------------ bad input


AS_IT_IS = Cut()


def read_whole(folder, name, cut, settings):
    clips = clips_by_name(layout(name, **settings).flights(folder), folder, cut)
    for clip in clips.values():
        for frame, _ in enumerate(clip.views()):
            clip.image(frame)


def refused(folder, name="plain", cut=AS_IT_IS, **settings):
    with pytest.raises(UserError) as raised:
        read_whole(folder, name, cut, settings)
    text = str(raised.value)
    assert "\n" not in text
    return text


@pytest.fixture
def plain(clip, tmp_path):
    foreign.write_plain(clip, tmp_path / "flight")
    return tmp_path


def edit(path, change):
    change(table := pd.read_csv(path))
    table.to_csv(path, index=False)


def replaced(path, array):
    Image.fromarray(array).save(path)


def test_what_cannot_be_a_recording_is_refused_in_one_line(plain, clip):
    flight = plain / "flight"
    names = "rgb/000003.png", "depth/000003.npy", "class/000003.png", "poses.csv"
    rgb, depth, strange, poses = (flight / name for name in names)

    def after(change, undo_of, **settings):
        kept = undo_of.read_bytes()
        change()
        text = refused(plain, **settings)
        undo_of.write_bytes(kept)
        return text

    ids, image = clip.aux("class", 3), clip.image(3)
    assert "class 99 is in no list" in after(
        lambda: replaced(strange, np.where(ids == 1, 99, ids).astype(np.uint8)), strange
    )
    assert "holds colors" in after(lambda: replaced(strange, image), strange)
    assert "is 95x64" in after(lambda: replaced(strange, ids[:, 1:]), strange)
    small = clip.aux("depth", 3)[:, 1:]
    assert "depth/000003.npy: is 95x64" in after(lambda: np.save(depth, small), depth)
    zero = np.zeros_like(clip.aux("depth", 3))
    assert "depths are zero" in after(lambda: np.save(depth, zero), depth)
    assert "000003.png is empty" in after(lambda: rgb.write_bytes(b""), rgb)
    assert "is 95x64, and the first image" in after(lambda: replaced(rgb, image[:, 1:]), rgb)

    def poses_with(change):
        return after(lambda: edit(poses, change), poses)

    assert "row 4 of the poses is not finite" in poses_with(
        lambda table: table.__setitem__("x_m", table.x_m.where(table.index != 4))
    )
    assert "has a length of 2" in poses_with(lambda table: table.update(2 * table.filter(like="q")))
    later = poses_with(
        lambda table: table.update({"time_s": table.time_s.where(table.index != 2, 0)})
    )
    assert "the time of row 2 is not later" in later
    gap = poses_with(lambda table: table.update({"time_s": table.time_s + 3 * (table.index > 9)}))
    assert "rows 9 and 10 are 3.4 s apart" in gap
    assert "has 29 poses" in after(
        lambda: pd.read_csv(poses)[:-1].to_csv(poses, index=False), poses
    )
    assert "has no column qw" in after(
        lambda: pd.read_csv(poses).drop(columns="qw").to_csv(poses, index=False), poses
    )

    far = poses_with(lambda table: table.update({"x_m": table.x_m + 4.6e6}))
    assert "subtract the first place" in far

    actors, camera = flight / "actors.csv", flight / "camera.json"

    def actors_with(change):
        return after(lambda: edit(actors, change), actors)

    assert "actor_id: give whole numbers above 0" in actors_with(
        lambda table: table.update({"actor_id": 0 * table.actor_id})
    )
    assert "length_m, width_m, height_m: give metres" in actors_with(
        lambda table: table.update({"width_m": -table.width_m})
    )
    assert "an actor is twice in one frame" in actors_with(
        lambda table: table.update({"frame": 0 * table.frame})
    )
    told = json.loads(camera.read_text())

    def camera_with(**changes):
        return after(lambda: camera.write_text(json.dumps({**told, **changes})), camera)

    assert "three numbers: forward, left and up" in camera_with(position_m=[0.1])
    assert "three numbers" in camera_with(pitch_deg=math.nan)
    larger = (np.array(told["pix_from_camera"]) * [[10], [10], [1]]).tolist()
    assert "is far from the middle of 96x64 pixels" in camera_with(pix_from_camera=larger)

    assert "task.rate_hz" in refused(plain, cut=Cut(rate_hz=2.0))
    shutil.copytree(flight, plain / "run 1")
    shutil.copytree(flight, plain / "run_1")
    assert "its clips would have the name run_1" in refused(plain)
    assert "is it of another layout" in refused(plain, "carla")
    assert "layout.axes" in refused(plain, axes="down")
    assert "layout.classes.cars" in refused(plain, classes={"cars": [5]})
    assert "listed twice" in refused(plain, classes={"car": [1]})


def test_what_carla_and_airsim_cannot_have_told_is_refused_in_one_line(clip, tmp_path):
    foreign.write_carla(clip, tmp_path / "carla/f")
    path = tmp_path / "carla/f/frames.json"
    told = json.loads(path.read_text())

    def carla(**changes):
        path.write_text(json.dumps({**told, **changes}))
        return refused(tmp_path / "carla", "carla")

    first, *others = told["frames"]
    lost = {**first, "camera": {**first["camera"], "x": float("nan")}}
    assert "row 0 of the poses is not finite" in carla(frames=[lost, *others])
    assert "frame 0: lacks camera" in carla(frames=[{"time_s": 0.0}, *others])
    assert "fov_deg: could not convert" in carla(fov_deg="wide")
    assert "frames.json: fov_deg: hfov: 270 degrees" in carla(fov_deg=270)
    assert "frames is no list" in carla(frames=5)
    boxed = {**first, "actors": [{**each, "box": [0, 0, 1]} for each in first["actors"]]}
    assert "actors: " in carla(frames=[boxed, *others])
    assert "has 0 poses" in carla(frames=[])
    assert "not those since 0.9.14" in carla(version="0.9.13")
    path.write_text(json.dumps({**told, "version": "0.9.15-dirty"}))
    assert layout("carla").flights(tmp_path / "carla")

    foreign.write_airsim(clip, tmp_path / "airsim/f")
    path = tmp_path / "airsim/f/airsim_rec.txt"
    text = path.read_text()
    path.write_text(text.replace("POS_X", "X"))
    assert "no column POS_X" in refused(tmp_path / "airsim", "airsim")
    path.write_text(text.replace("Drone\t0.0\t", "Drone\tnoon\t"))
    assert "holds words" in refused(tmp_path / "airsim", "airsim")


def test_a_recording_shorter_than_a_clip_is_refused(plain):
    flight = plain / "flight"
    pd.read_csv(flight / "poses.csv")[:20].to_csv(flight / "poses.csv", index=False)
    (flight / "actors.csv").unlink()
    for path in flight.glob("*/0000[2-9]*"):
        path.unlink()
    assert "lasts 8.0 s" in refused(plain)


def test_grey_turned_transparent_and_deep_images_are_read(tmp_path):
    image = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    path = tmp_path / "image.png"
    opaque = np.full((4, 6, 1), 7, np.uint8)
    replaced(path, np.concatenate([image, opaque], axis=-1))
    assert (read_rgb(path, (6, 4)) == image).all()
    replaced(path, image[..., 0])
    assert (read_rgb(path, (6, 4)) == image[..., :1]).all()
    replaced(path, image[..., 0].astype(np.uint16) * 256)
    assert (read_rgb(path, (6, 4)) == image[..., :1]).all()

    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise
    Image.fromarray(image).save(path, exif=exif)
    assert (read_rgb(path, (4, 6)) == np.rot90(image, -1)).all()


def test_pixels_without_a_class_hide_and_vote_for_nothing(clip, tmp_path):
    """Class 254 is none, at a finite depth: what lies there is neither occupied nor known."""
    made = written(clip, tmp_path, classes={"building": [], "unknown": [0, 254]})
    assert (made.aux("class", 0) != 0).all()
    walls = clip.aux("class", 0) == 0
    assert walls.any()
    assert np.isfinite(made.aux("depth", 0)[walls]).all()
    for frame in range(0, len(clip), 10):
        assert not (made.semantics(frame) == 0).any()


# As AirSim itself has written them, and as TartanAir's tools have the palette.
AIRSIM_ROWS = """\
VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile
PX4\t1726962106112\t-0.0859381\t-0.0884584\t-2.83123\t0.999988\t0.000118479\t-0.00453876\t0.00159355\t\
img_PX4__0_1726962106110372500.png;img_PX4__1_1726962106110372500.pfm;img_PX4__5_1726962106110372500.png
PX4\t1726962106953\t-0.132811\t-0.167176\t-5.46692\t0.99992\t0.00708\t-0.0102559\t0.00215091\t\
img_PX4__0_1726962106950954700.png;img_PX4__1_1726962106950954700.pfm;img_PX4__5_1726962106950954700.png
"""


@pytest.mark.parametrize("palette", ["0, 0, 0\n153, 108, 6\n", "0\t[0, 0, 0]\n1\t[153, 108, 6]\n"])
def test_rows_of_a_real_recording_are_understood(tmp_path, palette):
    (tmp_path / "airsim_rec.txt").write_text(AIRSIM_ROWS)
    (tmp_path / "seg_rgbs.txt").write_text(palette)
    image = np.zeros((64, 96, 3), np.uint8)
    for stamp in ("106110372500", "106950954700"):
        foreign.save(tmp_path / "images", f"img_PX4__0_1726962{stamp}.png", image)
    [flight] = layout("airsim").flights(tmp_path)

    assert flight.ids == {0: 0, 153 << 16 | 108 << 8 | 6: 1}
    assert np.diff(flight.time_s).tolist() == pytest.approx([0.841])
    # Up is up, and what was to the right (east of north) is y < 0.
    assert flight.world_from_body[:, 2, 3].tolist() == [2.83123, 5.46692]
    assert flight.world_from_body[0, 1, 3].item() == 0.0884584
    assert [path.name[:12] for path in flight.files["depth"]] == ["img_PX4__1_1"] * 2


def test_depth_lies_as_their_own_tools_write_it(tmp_path):
    """AirSim's pfm begins with the upper row, which the format forbids; TartanAir's png is of
    OpenCV, which takes the bytes of a float for blue, green, red and alpha."""
    depth_m = np.linspace(1.5, 90.0, 64 * 96, dtype="<f4").reshape(64, 96)
    (tmp_path / "airsim/images").mkdir(parents=True)
    (tmp_path / "airsim/airsim_rec.txt").write_text(AIRSIM_ROWS)
    (tmp_path / "airsim/seg_rgbs.txt").write_text("0, 0, 0\n153, 108, 6\n")
    black = np.zeros((64, 96, 3), np.uint8)
    brown = np.full_like(black, (153, 108, 6))
    for stamp in ("106110372500", "106950954700"):
        names = [f"img_PX4__{kind}_1726962{stamp}" for kind in (0, 1, 5)]
        foreign.save(tmp_path / "airsim/images", f"{names[0]}.png", black)
        foreign.save(tmp_path / "airsim/images", f"{names[2]}.png", brown)
        content = b"Pf\n96 64\n-1.0\n" + depth_m.tobytes()
        (tmp_path / f"airsim/images/{names[1]}.pfm").write_bytes(content)
    [flight] = layout("airsim").flights(tmp_path / "airsim")
    assert (flight.depth_m(0) == depth_m).all()

    for kind, image in (("image", black), ("seg", black[..., 0])):
        foreign.save(tmp_path / f"tartan/{kind}_lcam_front", "000000_lcam_front.png", image)
    (tmp_path / "tartan/depth_lcam_front").mkdir()
    path = tmp_path / "tartan/depth_lcam_front/000000_lcam_front_depth.png"
    cv2.imwrite(str(path), depth_m.view(np.uint8).reshape(64, 96, 4))
    (tmp_path / "tartan/pose_lcam_front.txt").write_text("0 0 0 0 0 0 1\n")
    (tmp_path / "tartan/seg_label_map.json").write_text('{"name_map": {"wall": 0}}')
    [flight] = layout("tartanair").flights(tmp_path / "tartan")
    assert (flight.depth_m(0) == depth_m).all()


def test_a_separator_at_the_end_of_lines_moves_no_column(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b,note\n1,2,3,\n4,5,6,\n")
    assert read_table(path, ["a", "b"])[["a", "b"]].to_numpy().tolist() == [[1, 2], [4, 5]]
    path.write_text("a,b\n")
    with pytest.raises(UserError, match="has no rows"):
        read_table(path, ["a", "b"])


def test_files_are_paired_by_their_numbers(tmp_path):
    """Without zeros in front, 10 would come before 9."""
    folder = tmp_path / "rgb"
    folder.mkdir()
    for number in range(12):
        (folder / f"{number}.png").touch()
    assert [path.stem for path in files_of(folder, ".png")] == [str(n) for n in range(12)]

    rows = [[Path(f"rgb/{n:04d}.png") for n in range(3)], []]
    rows[1] = [Path(f"depth/d{n}.npy") for n in range(3)]
    require_frames(Path("f/poses.csv"), rows, 3)
    rows[1] = [Path(f"depth/d{n}.npy") for n in (0, 2, 3)]
    with pytest.raises(UserError, match=r"rgb/0001\.png, depth/d2\.npy would be one frame"):
        require_frames(Path("f/poses.csv"), rows, 3)


def test_carla_s_transforms_may_be_nested_and_its_vehicles_want_their_box():
    flat = {"x": 3.0, "y": 4.0, "z": 1.0, "roll": 0.0, "pitch": 5.0, "yaw": 90.0}
    nested = {
        "location": {name: flat[name] for name in "xyz"},
        "rotation": {name: flat[name] for name in ("roll", "pitch", "yaw")},
    }
    assert torch.equal(matrix_of(flat), matrix_of(nested))

    actor = {"id": 7, "type": "car", **flat, "extent": {"x": 2.0, "y": 1.0, "z": 0.8}}
    with pytest.raises(ValueError, match="actor 7 lacks box"):
        tracks_of([{"actors": [actor]}])
    boxes = [{"x": 0.0, "y": 0.0, "z": 0.8}, {"location": {"x": 0.0, "y": 0.0, "z": 0.8}}]
    flat_box, nested_box = (tracks_of([{"actors": [actor | {"box": each}]}])[0] for each in boxes)
    assert (flat_box.position_m == nested_box.position_m).all()
    assert flat_box.position_m[0, 2] == pytest.approx(1.0)
