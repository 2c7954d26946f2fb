"""task=export_labels: what it writes is read back bit for bit, and scored as the original is."""

import io
import json

import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image

from src.data.clip import Clip
from src.data.predictions import PredictedFrame, Predictions, save_predictions
from src.data.truth import SkyShieldTruth, truth_at
from src.errors import UserError
from src.formats import WRITTEN_FORMATS
from src.formats.folder import LabelFolder
from src.formats.layout import LAYOUT, layout_beside
from src.geometry import VoxelGrid, rigid, rotation_from_quat, world_from_occ
from src.ontology import CLASSES, COLORS, FREE, OCCUPIED, UNKNOWN
from src.results.files import read_results
from src.tasks.export_labels import export_labels
from src.tasks.score import score
from tests.synthetic import compose_config, mini_overrides, write_dataset

# The mask of each format that marks every voxel with a label.
KNOWN = {"occ3d": "mask_lidar", "semantickitti": "valid", "occufly": "valid"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    return write_dataset(compose_config(*mini_overrides(folder)))


@pytest.fixture(scope="module")
def predictions(dataset, tmp_path_factory):
    """Of every voxel a class of ours, with all nine, so that every id is written and read."""
    source = SkyShieldTruth(dataset, "test")
    rng = torch.Generator().manual_seed(0)

    def frames():
        for clip, frame in source.samples:
            labels = source.truth(clip, frame)["semantics"][0]
            guess = torch.randint(0, len(CLASSES), labels.shape, generator=rng)
            is_wrong = (labels == UNKNOWN) | (torch.rand(labels.shape, generator=rng) < 0.3)
            yield PredictedFrame(clip, frame, torch.where(is_wrong, guess, labels).byte())

    folder = tmp_path_factory.mktemp("predicted") / "mine"
    save_predictions(folder, {"name": "mine"}, frames())
    return folder


def config_of(dataset, *words):
    few = "suite.resamples=20", "suite.rays=[10,6]"
    return compose_config(*mini_overrides(dataset.parent), f"dataset={dataset}", *few, *words)


def exported(dataset, out, kind, predictions=None, part="test"):
    words = [f"predictions={predictions}"] if predictions else []
    export_labels(config_of(dataset, "task=export_labels", *words), kind, part, str(out))
    return out


def folder_of(kind, root, predicted=False):
    """The frames of an exported folder, read with nothing but what lies in it."""
    layout = layout_beside(root, kind)
    grid = VoxelGrid(**layout["grid"])
    return LabelFolder(WRITTEN_FORMATS[kind], root, layout["class_map"], grid, predicted)


def clip_names(kind, clips):
    return {WRITTEN_FORMATS[kind].scene_of(clip, n): clip for n, clip in enumerate(clips)}


# --------------------------------------------------------------------------------- bit for bit


@pytest.mark.parametrize("kind", WRITTEN_FORMATS)
def test_labels_and_masks_are_read_back_bit_for_bit(dataset, tmp_path, kind):
    folder = folder_of(kind, exported(dataset, tmp_path / "out", kind))
    source = SkyShieldTruth(dataset, "test")
    clips = clip_names(kind, source.clips)
    of_samples = [(clips[scene], int(token)) for scene, token in folder.samples]
    assert sorted(of_samples) == sorted(source.samples)
    seen = "mask_camera" if kind == "occ3d" else "visible"
    for sample, (clip, frame) in zip(folder.samples, of_samples):
        truth = source.truth(clip, frame)
        known = folder.mask(*sample, KNOWN[kind])
        labels = torch.where(known, folder.labels(*sample), UNKNOWN)
        assert torch.equal(labels, truth["semantics"][0])
        assert torch.equal(folder.mask(*sample, seen), truth["visible"][0] & known)


@pytest.mark.parametrize("kind", WRITTEN_FORMATS)
def test_predictions_of_all_classes_are_read_back_bit_for_bit(dataset, predictions, tmp_path, kind):
    root = exported(dataset, tmp_path / "out", kind, predictions)
    folder, source = folder_of(kind, root, predicted=True), SkyShieldTruth(dataset, "test")
    clips = clip_names(kind, source.clips)
    for scene, token in folder.samples:
        expected = Predictions(predictions).labels(clips[scene], int(token))
        assert set(expected.unique().tolist()) == set(range(len(CLASSES)))
        assert torch.equal(folder.labels(scene, token), expected)


def first_frame(dataset):
    """The first frame of the flight that is held out: it shows ground and both boxes."""
    return Clip(dataset / "suburb/clip00"), "suburb/clip00", 0


def test_semantickitti_s_files_are_as_its_own_tools_read_them(dataset, tmp_path):
    """As semantic-kitti-api does: uint16 x, y, z; the first voxel is a byte's highest bit."""
    root = exported(dataset, tmp_path / "out", "semantickitti", part="all")
    clip, name, frame = first_frame(dataset)
    number = list(SkyShieldTruth(dataset).clips).index(name)
    path = root / f"sequences/{number:02d}/voxels/{frame:06d}.label"
    truth = clip.semantics(frame)
    labels = np.fromfile(path, np.uint16).reshape(truth.shape)
    invalid = np.fromfile(path.with_suffix(".invalid"), np.uint8)
    bits = np.stack([invalid >> (7 - n) & 1 for n in range(8)], axis=1).reshape(-1)
    assert (bits[: truth.size].reshape(truth.shape) == (truth == UNKNOWN)).all()
    assert set(labels[truth == CLASSES.index("building")]) == {50}
    assert set(labels[truth == CLASSES.index("ground")]) == {40}
    assert not labels[truth >= FREE].any()


def test_occufly_s_axes_are_right_down_and_forward(dataset, tmp_path):
    root = exported(dataset, tmp_path / "out", "occufly")
    clip, name, frame = first_frame(dataset)
    path = root / f"{name}/ground_truth/{frame:06d}/{frame:06d}.label"
    x, y, z = clip.semantics(frame).shape
    theirs = np.fromfile(path, np.uint8).reshape(y, z, x)
    for right, down, forward in [(0, 0, 0), (y - 1, z - 2, 3), (4, 2, x - 1), (9, z - 3, 9)]:
        ours = clip.semantics(frame)[forward, y - 1 - right, z - 1 - down]
        expected = 255 if ours == UNKNOWN else WRITTEN_FORMATS["occufly"].ids[CLASSES[ours]]
        assert theirs[right, down, forward] == expected
    assert 1 in theirs[:, -3, :], "the ground is below"


# ------------------------------------------------------------------------------------ scoring


SCORES = ["miou", "miou_occupied", "kar_miou"]


def results_of(dataset, predictions, *words):
    cfg = config_of(dataset, "task=score", f"predictions={predictions}", *words)
    score(cfg, "test", False, None)
    folder = predictions / "scores"
    return read_results(folder / "results.csv"), pd.read_csv(folder / "scores.csv")


@pytest.fixture(scope="module")
def original(dataset, predictions):
    return results_of(dataset, predictions)


@pytest.mark.parametrize("kind", WRITTEN_FORMATS)
def test_an_exported_prediction_has_exactly_the_scores_of_the_original(
    dataset, predictions, original, tmp_path, kind
):
    truth = exported(dataset, tmp_path / "truth", kind)
    mine = exported(dataset, tmp_path / "mine", kind, predictions)
    words = f"dataset={truth}", f"layout={kind}", f"layout.mask={KNOWN[kind]}"
    rows, table = results_of(dataset, mine, *words)
    columns = [name for name in rows if name in SCORES or "iou/" in name]
    pd.testing.assert_frame_equal(rows[["split", *columns]], original[0][["split", *columns]])
    assert rows["kar_miou"].between(0.05, 0.9).all()
    # Their files have no camera, so that the scores along its rays are missing, and no other.
    keys = ["part", "score"]
    ours, theirs = (each.set_index(keys)["value"] for each in (original[1], table))
    assert {score for _, score in ours.index.difference(theirs.index)} == {
        score for _, score in ours.index if score.startswith("ray_")
    }
    pd.testing.assert_series_equal(theirs, ours.loc[theirs.index])

    # Without a word of their own, predictions have the ids of the labels.
    (mine / LAYOUT).unlink()
    again, _ = results_of(dataset, mine, *words)
    pd.testing.assert_frame_equal(again[columns], rows[columns])


# ----------------------------------------------------------------------------------- MCAP, PLY


def messages_of(path):
    reader = pytest.importorskip("mcap.reader")
    protobuf = pytest.importorskip("mcap_protobuf.decoder")
    with path.open("rb") as file:
        decoders = [protobuf.DecoderFactory()]
        every = reader.make_reader(file, decoder_factories=decoders).iter_decoded_messages()
        return [
            (channel.topic, message.log_time, content) for _, channel, message, content in every
        ]


def labels_in(voxels):
    """Labels [X, Y, Z] of a message, by its own strides and the offset of the field."""
    data = np.frombuffer(voxels.data, np.uint8)
    offset = {field.name: field.offset for field in voxels.fields}
    slices = len(data) // voxels.slice_stride
    z, y, x = np.indices((slices, voxels.row_count, voxels.column_count))
    start = z * voxels.slice_stride + y * voxels.row_stride + x * voxels.cell_stride
    cells = {name: data[start + each].transpose(2, 1, 0) for name, each in offset.items()}
    color = np.stack([cells[name] for name in ("red", "green", "blue")], axis=-1)
    return cells["class_id"], color, cells["alpha"]


def matrix_of(message):
    turn, place = message.rotation, message.translation
    rotation = rotation_from_quat(np.array([turn.x, turn.y, turn.z, turn.w]))
    return rigid(rotation, np.array([place.x, place.y, place.z]))


@pytest.fixture(scope="module")
def recorded(dataset, predictions, tmp_path_factory):
    return exported(dataset, tmp_path_factory.mktemp("mcap") / "out", "mcap", predictions)


def test_an_mcap_holds_labels_images_poses_and_the_camera(dataset, predictions, recorded):
    pytest.importorskip("foxglove")
    source = SkyShieldTruth(dataset, "test")
    assert {f"{clip}.mcap" for clip, _ in source.samples} == {
        path.relative_to(recorded).as_posix() for path in recorded.rglob("*") if path.is_file()
    }
    for name in dict(source.samples):
        clip, frames = source.clips[name], [n for each, n in source.samples if each == name]
        messages = messages_of(recorded / f"{name}.mcap")
        times_ns = [round(clip.frames["time_s"][frame] * 1e9) for frame in frames]
        assert sorted({time for _, time, _ in messages}) == times_ns
        for frame, time_ns in zip(frames, times_ns):
            at = [(topic, message) for topic, time, message in messages if time == time_ns]
            of_topic = dict(at)
            truth, color, alpha = labels_in(of_topic["/truth"])
            assert (truth == clip.semantics(frame)).all()
            assert ((alpha == 255) == np.isin(truth, OCCUPIED)).all()
            assert (color[truth == 0] == COLORS["building"]).all()
            predicted, _, _ = labels_in(of_topic["/prediction"])
            assert (predicted == Predictions(predictions).labels(name, frame).numpy()).all()
            transforms = {
                (m.parent_frame_id, m.child_frame_id): matrix_of(m) for t, m in at if t == "/tf"
            }
            pose = clip.world_from_body[frame].numpy()
            expected = {
                ("world", "body"): pose,
                ("body", "camera"): clip.meta.body_from_camera.numpy(),
                ("world", "occ"): world_from_occ(pose),
            }
            assert transforms.keys() == expected.keys()
            for key, matrix in expected.items():
                assert np.abs(transforms[key] - matrix).max() < 1e-12
            stamp = of_topic["/camera/image"].timestamp
            assert stamp.seconds * 10**9 + stamp.nanos == time_ns


def test_a_voxel_of_an_mcap_is_where_its_pixel_says(dataset, recorded):
    """Pose, cell size, transforms and calibration together: as a viewer draws them."""
    clip, name, frame = first_frame(dataset)
    of_topic, chain = {}, {}
    for topic, _, message in reversed(messages_of(recorded / f"{name}.mcap")):
        of_topic[topic] = message
        if topic == "/tf":
            chain[message.parent_frame_id, message.child_frame_id] = matrix_of(message)
    voxels, camera, image = (
        of_topic[topic] for topic in ("/truth", "/camera/calibration", "/camera/image")
    )
    assert voxels.frame_id == "occ"
    assert camera.frame_id == image.frame_id == "camera"
    assert (camera.width, camera.height) == (clip.meta.width, clip.meta.height)
    corner, cell = voxels.pose.position, voxels.cell_size
    index = np.array([7, 12, 6])
    center = (index + 0.5) * (cell.x, cell.y, cell.z) + (corner.x, corner.y, corner.z)
    assert np.allclose(center, clip.meta.grid.centers(torch.float64)[tuple(index)])
    camera_from_world = np.linalg.inv(chain["world", "body"] @ chain["body", "camera"])
    point = camera_from_world @ chain["world", "occ"] @ np.array([*center, 1.0])
    u, v, depth_m = np.reshape(camera.K, (3, 3)) @ point[:3]
    truth = truth_at(clip, frame)
    ours = truth["camera_from_occ"][0].numpy() @ np.array([*center, 1.0])
    pix = truth["pix_from_camera"][0].numpy() @ ours[:3]
    # OpenCV's first pixel has its center at 0, and ours at 0.5.
    assert np.allclose((u / depth_m, v / depth_m), pix[:2] / pix[2] - 0.5)
    assert np.allclose(np.reshape(camera.P, (3, 4))[:, :3], np.reshape(camera.K, (3, 3)))
    shown = np.asarray(Image.open(io.BytesIO(image.data)), np.float64)
    assert np.abs(shown - clip.image(frame)).mean() < 3


def test_a_ply_has_the_occupied_voxels_and_no_other(dataset, tmp_path):
    root = exported(dataset, tmp_path / "out", "ply")
    clip, name, frame = first_frame(dataset)
    header, _, data = (root / f"{name}/{frame:06d}.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    kinds = {"float": "<f4", "uchar": "u1"}
    properties = [line.split()[1:] for line in lines if line.startswith("property")]
    vertices = np.frombuffer(data, np.dtype([(name, kinds[kind]) for kind, name in properties]))
    assert f"element vertex {len(vertices)}" in lines
    points = torch.tensor(np.stack([vertices[axis] for axis in "xyz"], axis=-1))
    index, inside = clip.meta.grid.index_of(points)
    labels = np.full(clip.meta.grid.shape, FREE, np.uint8)
    labels[tuple(index.numpy().T)] = vertices["class_id"]
    truth = clip.semantics(frame)
    assert inside.all()
    assert (labels == np.where(truth == UNKNOWN, FREE, truth)).all()
    assert len(vertices) == np.isin(truth, OCCUPIED).sum()
    assert (
        tuple(vertices[0][name] for name in ("red", "green", "blue"))
        == COLORS[CLASSES[vertices[0]["class_id"]]]
    )


# ------------------------------------------------------------------------------------ refusals


def test_nothing_is_written_over_files_and_nothing_half(
    dataset, predictions, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    out.mkdir()
    exported(dataset, out, "ply")  # an empty folder is as good as none
    with pytest.raises(UserError, match=r"task\.out: .*out is there already and not empty; choose"):
        exported(dataset, out, "ply")

    written = []

    def fail(path, *_):
        if written:
            raise OSError(28, "No space left on device")
        written.append(path.write_bytes(b"ply"))

    monkeypatch.setattr("src.tasks.export_labels.write_ply", fail)
    with pytest.raises(UserError, match=r"new: cannot be written .* free some space"):
        exported(dataset, tmp_path / "new", "ply")
    assert written
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("kind", "part", "message"),
    [
        ("semantickiti", "test", r"task\.format: 'semantickiti'; did you mean 'semantickitti'\?"),
        ("csv", "test", r"task\.format: 'csv'; there are occ3d, .*, mcap"),
        ("ply", "tests", r"task\.part: 'tests'; there are train, val, test, all"),
        ("ply", "val", r"missing: .* extra: .*; give the task\.part that they are of"),
    ],
)
def test_what_cannot_be_written_is_one_line(dataset, predictions, tmp_path, kind, part, message):
    with pytest.raises(UserError, match=message) as told:
        exported(dataset, tmp_path / "out", kind, predictions, part)
    assert "\n" not in str(told.value)
    assert not [*tmp_path.iterdir()]


def cut(path):
    path.write_bytes(path.read_bytes()[:-3])


def another_id(path):
    path.write_bytes(b"\xfa" + path.read_bytes()[1:])


def rewrite(change):
    def damage(path):
        root = next(each for each in path.parents if (each / LAYOUT).is_file())
        content = json.loads((root / LAYOUT).read_text())
        change(content)
        (root / LAYOUT).write_text(json.dumps(content))

    return damage


DAMAGES = {
    "cut": (cut, r"\.label: has \d+ bytes, and a grid of \[25, 25, 15\] takes \d+; state layout"),
    "no such class": (another_id, r"\.label: class 250 is not in layout\.class_map"),
    "another grid": (
        rewrite(lambda content: content["grid"].update(upper_m=[50, 25, 12], shape=[25, 25, 16])),
        r"layout\.json: grid: is another than that of",
    ),
    "a class that there is not": (
        rewrite(lambda content: content["class_map"].update({"16": "bilding"})),
        r"layout\.class_map: 'bilding' is no class; did you mean 'building'\?",
    ),
    "no velocity": (
        rewrite(lambda content: content["velocity_mps"].popitem()),
        r"layout\.json: velocity_mps: has no .*/000029; add it",
    ),
    "another format": (
        rewrite(lambda content: content.update(layout="semantickitti")),
        r"layout\.json: these are files of semantickitti; score them with layout=semantickitti",
    ),
    "no grid": (
        rewrite(lambda content: content.pop("grid")),
        r"layout\.json: cannot be read \('grid'\); write",
    ),
}


@pytest.mark.parametrize("case", DAMAGES)
def test_damaged_files_are_named_before_any_score_is_written(dataset, predictions, tmp_path, case):
    truth = exported(dataset, tmp_path / "truth", "occufly")
    mine = exported(dataset, tmp_path / "mine", "occufly", predictions)
    damage, message = DAMAGES[case]
    broken = mine if case in ("cut", "no such class") else truth
    damage(sorted(broken.rglob("*.label"))[0])
    with pytest.raises(UserError, match=message) as told:
        results_of(dataset, mine, f"dataset={truth}", "layout=occufly")
    assert "\n" not in str(told.value)
    assert not (mine / "scores").exists()


def test_a_layout_that_there_is_not_is_named_with_the_nearest(dataset, predictions):
    words = f"dataset={dataset}", "layout.name=ocufly"
    with pytest.raises(UserError, match=r"^layout\.name: 'ocufly'; did you mean 'occufly'\?"):
        results_of(dataset, predictions, *words)
    with pytest.raises(UserError, match=r"^layout\.velocity_mps: files of occufly do not say it"):
        results_of(dataset, predictions, f"dataset={dataset}", "layout=occufly")


@pytest.mark.parametrize("kind", ["semantickitti", "occufly"])
def test_ids_that_are_written_mean_the_same_in_the_format_s_own_table(kind):
    own = compose_config(f"layout={kind}").layout.class_map
    ids = WRITTEN_FORMATS[kind].ids
    assert set(CLASSES) <= set(ids)
    assert len(set(ids.values())) == len(ids)
    for name, number in ids.items():
        assert own[number] == name
