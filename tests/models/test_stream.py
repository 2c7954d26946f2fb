"""Streaming inference against the batch path, frame by frame, and what a stream must refuse."""

import pytest
import torch

from src.data.dataset import OccupancyDataset, velocity_world_mps
from src.errors import UserError
from src.geometry import VoxelGrid, front_mount, inverse, pinhole, rigid
from src.models.frame import StreamFrame
from src.models.ground import above_ground
from src.models.stream import SHAPES, SkyOccStream
from src.parallax import Parallax
from tests.models.synthetic import build_network

GRID = VoxelGrid(shape=(25, 25, 15))
MOVED = rigid(torch.eye(3), torch.tensor([3.0, 4.0, 9.0]))
HISTORY_STEP_S = 0.4


@pytest.fixture
def network():
    return build_network(grid=GRID)


@pytest.fixture
def stream(network):
    return SkyOccStream(network, HISTORY_STEP_S)


def frame_of(clips, name, frame, **changes):
    clip = clips[name]
    return StreamFrame(
        image=torch.from_numpy(clip.image(frame).copy()).permute(2, 0, 1),
        time_s=frame / 5,
        world_from_body=clip.world_from_body[frame],
        velocity_mps=velocity_world_mps(clip, frame),
        pix_from_camera=clip.meta.pix_from_camera,
        body_from_camera=clip.meta.body_from_camera,
        clip=name,
    )._replace(**changes)


@torch.no_grad()
def batch_logits(network, clips, name, frame, frames=4):
    sample = OccupancyDataset(clips, [(name, frame)], frames, HISTORY_STEP_S)[0]
    batch = {k: v[None] for k, v in sample.items() if isinstance(v, torch.Tensor)}
    return network.eval()(batch)[0]


def close(logits, expected):
    torch.testing.assert_close(logits, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_a_stream_gives_what_the_batch_path_gives(clips, frames):
    """From the first frame, without history, to where all of it is there; at twice its rate."""
    network = build_network(grid=GRID, encoder={"num_frames": frames})
    stream = SkyOccStream(network, HISTORY_STEP_S)
    for frame in range(10):
        logits = stream(frame_of(clips, "town/a", frame))
        close(logits, batch_logits(network, clips, "town/a", frame, frames))
    assert len(stream.past) == 2 * (frames - 1) + 1, "and it keeps no more than it needs"


def test_the_recursive_stream_equals_the_batch_path_as_far_as_its_queue(clips):
    network = build_network(grid=GRID, history="recursive")
    stream = SkyOccStream(network, HISTORY_STEP_S)
    for frame in range(0, 8, 2):
        logits = stream(frame_of(clips, "town/a", frame))
        close(logits, batch_logits(network, clips, "town/a", frame))
    logits = stream(frame_of(clips, "town/a", 8))
    beyond = (logits - batch_logits(network, clips, "town/a", 8)).abs().max()
    assert 0 < beyond < 1, "beyond it, the stream remembers more"


@pytest.mark.parametrize("projection", ["attitude", "level"])
def test_a_stream_compares_the_frames_that_the_batch_path_compares(clips, projection):
    parallax = Parallax([0.2, 0.4, 0.8], bins=12, projection=projection)
    encoder = {"num_frames": 2, "projection": projection}
    network = build_network(grid=GRID, encoder=encoder, parallax=parallax)
    stream = SkyOccStream(network, HISTORY_STEP_S)
    for frame in range(7):
        current = frame_of(clips, "town/a", frame)
        samples = OccupancyDataset(clips, [("town/a", frame)], 2, HISTORY_STEP_S, parallax=parallax)
        sample = samples[0]
        assert stream.arguments(current)[0]["parallax"][0].equal(sample["parallax"])

        batch = {k: v[None] for k, v in sample.items() if isinstance(v, torch.Tensor)}
        with torch.no_grad():
            close(stream(current), network.eval()(batch)[0])
    assert len(stream.past) == 5


def test_a_stream_of_images_of_two_sizes_is_refused(clips):
    network = build_network(grid=GRID, parallax=Parallax([0.2], bins=12))
    stream = SkyOccStream(network, HISTORY_STEP_S)
    stream(frame_of(clips, "town/a", 0))
    frame = frame_of(clips, "town/a", 1)
    with pytest.raises(UserError, match=r"^image: 96x64, 96x32 .* one size"):
        stream(frame._replace(image=frame.image[:, :32], pix_from_camera=pinhole(96, 32, 1.5)))


@pytest.mark.parametrize(("clip", "number"), [("town/b", 10), ("town/a", 9)])
def test_another_clip_or_a_gap_in_time_begins_without_history(clips, network, stream, clip, number):
    for frame in range(6):
        stream(frame_of(clips, "town/a", frame))
    alone = SkyOccStream(network, HISTORY_STEP_S)(frame_of(clips, clip, number))
    assert stream(frame_of(clips, clip, number)).equal(alone)


def test_a_frame_out_of_order_is_refused_and_changes_nothing(clips, network, stream):
    for frame in range(5):
        stream(frame_of(clips, "town/a", frame))
    for frame in (3, 4):
        with pytest.raises(UserError, match=r"time_s: a frame of 0\.[68] s after one of 0\.8 s"):
            stream(frame_of(clips, "town/a", frame))
    close(stream(frame_of(clips, "town/a", 5)), batch_logits(network, clips, "town/a", 5))
    stream.reset()
    stream(frame_of(clips, "town/a", 0))


def test_arrays_and_single_precision_will_do(clips, network, stream):
    other = SkyOccStream(network, HISTORY_STEP_S)
    for number in (0, 2):
        frame = frame_of(clips, "town/a", number)
        arrays = {name: getattr(frame, name).float().numpy() for name in SHAPES if number}
        close(other(frame._replace(image=frame.image.numpy(), **arrays)), stream(frame))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        *((name, torch.full(SHAPES[name], torch.nan), "0.4 s") for name in SHAPES),
        ("velocity_mps", torch.tensor([0.0, 0.0, torch.inf]), "0.4 s"),
        ("world_from_body", torch.eye(4)[:3], r"\[3, 4\]; give \[4, 4\]"),
        ("image", torch.zeros(3, 64, 96), r"float32 \[3, 64, 96\]"),
        ("image", torch.zeros(64, 96, 3).byte(), r"uint8 \[64, 96, 3\]"),
        ("world_from_body", torch.zeros(4, 4), "last row"),
        ("world_from_body", MOVED.T, "transposed"),
        ("world_from_body", torch.diag(torch.tensor([1.0, -1, 1, 1])), "no rotation"),
        ("body_from_camera", torch.diag(torch.tensor([2.0, 2, 2, 1])), "no rotation"),
        ("pix_from_camera", torch.diag(torch.tensor([-48.0, 48, 1])), "focal lengths"),
        ("pix_from_camera", torch.diag(torch.tensor([48.0, 48, 2])), "last row"),
        ("pix_from_camera", torch.tensor([[0.5, 0, 0.5], [0, 0.5, 0.5], [0, 0, 1]]), "far from"),
        ("pix_from_camera", torch.tensor([[480.0, 0, 480], [0, 480, 320], [0, 0, 1]]), "far from"),
        ("pix_from_camera", torch.tensor([[48.0, 5, 48], [0, 48, 32], [0, 0, 1]]), "skew"),
        ("body_from_camera", torch.eye(4), "does not look ahead"),
        ("body_from_camera", inverse(front_mount((0.3, 0.0, 0.0))), "does not look ahead"),
        ("velocity_mps", torch.tensor([300.0, 0.0, 0.0]), "metres a second"),
        ("time_s", float("inf"), "not finite"),
        ("time_s", float("nan"), "not finite"),
    ],
)
def test_a_broken_frame_is_refused_and_changes_nothing(
    clips, network, stream, name, value, message
):
    stream(frame_of(clips, "town/a", 0))
    frame = frame_of(clips, "town/a", 2)
    with pytest.raises(UserError, match=f"{name}: .*{message}"):
        stream(frame._replace(**{name: value}))
    close(stream(frame), batch_logits(network, clips, "town/a", 2))


def at_height(frame, height_m):
    pose = frame.world_from_body.clone()
    pose[2, 3] = height_m
    return frame._replace(world_from_body=pose)


def test_a_height_at_which_nothing_could_be_seen_is_refused(clips):
    """z above sea level made everything free, without a word."""
    network = build_network(grid=GRID, volume=above_ground(GRID, -2.0, 30.0))
    stream, frame = SkyOccStream(network, HISTORY_STEP_S), frame_of(clips, "town/a", 0)
    for height_m in (452.0, 60.0, -5.0):
        with pytest.raises(UserError, match=r"world_from_body: z is .* not from sea level"):
            stream(at_height(frame, height_m))
    for height_m in (-0.5, 0.0, 18.0, 30.0):
        SkyOccStream(network, HISTORY_STEP_S)(at_height(frame, height_m))


def test_an_array_of_any_strides_and_byte_order_will_do(clips, network, stream):
    frame = frame_of(clips, "town/a", 0)
    bgr = frame.image.permute(1, 2, 0).numpy()[..., ::-1].copy()
    reversed_back = bgr[..., ::-1].transpose(2, 0, 1)
    pose = frame.world_from_body.numpy().astype(">f8")
    other = SkyOccStream(network, HISTORY_STEP_S)
    assert other(frame._replace(image=reversed_back, world_from_body=pose)).equal(stream(frame))


@pytest.mark.parametrize("time_of", [lambda n: n * 200_000_000, lambda n: n / 7])
def test_it_says_once_that_no_past_frame_ever_fits(clips, network, time_of, recwarn):
    """Times in nanoseconds, or a camera whose frames never are a history step apart."""
    stream = SkyOccStream(network, 0.2)
    for number in range(25):
        stream(frame_of(clips, "town/a", 0, time_s=time_of(number)))
    (told,) = recwarn.list
    assert "no frame has had a past one" in str(told.message)


def test_it_warns_of_a_height_at_which_no_weights_were_scored(clips, stream):
    frame = frame_of(clips, "town/a", 0)
    high = frame.world_from_body.clone()
    high[2, 3] = 20.5
    with pytest.warns(UserWarning, match="more than 20 m above the ground, .* do not trust"):
        stream(frame._replace(world_from_body=high))


@pytest.mark.parametrize("rate_hz", [5, 50])
def test_it_says_nothing_where_past_frames_come_in_time(clips, network, rate_hz, recwarn):
    stream = SkyOccStream(network, HISTORY_STEP_S)
    for number in range(30):
        stream(frame_of(clips, "town/a", 0, time_s=number / rate_hz))
    assert not recwarn.list


def test_images_of_another_size_than_the_training_s_are_refused(clips, stream):
    stream.size_pix = (96, 64)
    frame = frame_of(clips, "town/a", 0)
    stream(frame)
    other = {"image": frame.image[:, :32], "pix_from_camera": pinhole(96, 32, 1.5)}
    wide = frame_of(clips, "town/a", 1, **other)
    with pytest.raises(UserError, match=r"^image: 96x32 pixels, and the network knows 96x64"):
        stream(wide)
