"""Videos and folders of images: what is read, in which order, and what is refused."""

import struct
import subprocess
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from src.data.footage import footage_of
from src.errors import UserError
from tests.sessions import ROOT

SIZE = (64, 48)


def picture(value):
    """A picture whose left half is brighter."""
    image = np.full((SIZE[1], SIZE[0], 3), value, np.uint8)
    image[:, : SIZE[0] // 2] += 20
    return image


def write_video(path, frames=10, rate_hz=20):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate_hz, SIZE)
    for n in range(frames):
        writer.write(np.ascontiguousarray(picture(20 * n)[..., ::-1]))
    writer.release()
    return path


def with_steps(path, steps):
    """Rewrites an mp4 so that its frames are so many ticks apart. A box begins with its size."""

    def size_at(place):
        return int.from_bytes(data[place : place + 4], "big")

    data, place, around = path.read_bytes(), 0, []
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        while data[place + 4 : place + 8] != name:
            place += size_at(place)
        around.append(place)
        place += 8
    *around, start = around

    table = struct.pack(
        f">{2 + 2 * len(steps)}I", 0, len(steps), *(n for s in steps for n in (1, s))
    )
    new = struct.pack(">I", len(table) + 8) + b"stts" + table
    grown = len(new) - size_at(start)
    changed = bytearray(data[:start] + new + data[start + size_at(start) :])
    for each in around:
        changed[each : each + 4] = struct.pack(">I", size_at(each) + grown)
    path.write_bytes(changed)


def save(folder, name, image, **options):
    folder.mkdir(exist_ok=True)
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(
        folder / name, **options
    )


def test_a_video_gives_the_wanted_frames_at_their_times(tmp_path):
    video = footage_of(write_video(tmp_path / "a.mp4"))
    assert video.size_pix == SIZE
    assert video.times_s() == pytest.approx(np.arange(10) / 20)
    found = [image[24, 48].mean() for image in video.images([0, 3, 4, 9])]
    assert found == pytest.approx([0, 60, 80, 180], abs=6)


def test_frames_that_are_not_evenly_spaced_have_their_own_times(tmp_path):
    path = write_video(tmp_path / "a.mp4", frames=6, rate_hz=20)
    ticks = 512  # of 50 ms, as OpenCV writes them
    with_steps(path, [ticks // 2, ticks, 2 * ticks, ticks // 2, ticks, ticks])
    assert footage_of(path).times_s() == pytest.approx([0, 0.025, 0.075, 0.175, 0.2, 0.25])
    # A rate of the user's own goes before what the file says.
    assert footage_of(path).times_s(10) == pytest.approx(np.arange(6) / 10)


def test_a_video_that_ends_early_gives_what_it_has_and_says_so(tmp_path, capsys):
    video = footage_of(write_video(tmp_path / "a.mp4"))
    assert len([*video.images([8, 9, 10, 11])]) == 2
    assert "a.mp4: ends at frame 10 of 10" in capsys.readouterr().out


def test_colors_keep_their_order(tmp_path):
    red = np.zeros((48, 64, 3), np.uint8)
    red[..., 0] = 200
    writer = cv2.VideoWriter(str(tmp_path / "r.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 5, SIZE)
    writer.write(np.ascontiguousarray(red[..., ::-1]))
    writer.release()
    (image,) = footage_of(tmp_path / "r.mp4").images([0])
    assert np.abs(image.mean(axis=(0, 1)) - [200, 0, 0]).max() < 8


def test_numbers_without_zeros_in_front_are_in_order(tmp_path):
    for number in range(12):
        save(tmp_path / "images", f"frame_{number}.png", picture(20 * number))
    save(tmp_path / "images", "frame.png", picture(0))
    images = [*footage_of(tmp_path / "images").images(range(13))]
    assert [int(image[24, 48, 0]) for image in images[1:]] == [20 * n for n in range(12)]


def test_names_are_times_in_seconds_whatever_their_order(tmp_path):
    for time_s in (9.5, 10.25, 100.0):
        save(tmp_path / "a", f"{time_s}.png", picture(int(time_s)))
    pictures = footage_of(tmp_path / "a")
    assert pictures.times_s().tolist() == [9.5, 10.25, 100.0]
    assert [image[0, 60, 0] for image in pictures.images([0, 1, 2])] == [9, 10, 100]
    assert pictures.times_s(rate_hz=4.0).tolist() == [0, 0.25, 0.5]


@pytest.mark.parametrize(
    ("name", "told"), [("000001.png", "number is no time"), ("a.png", "no times")]
)
def test_other_names_need_a_rate(tmp_path, name, told):
    save(tmp_path / "a", name, picture(0))
    with pytest.raises(UserError, match=rf"{told}; give task\.rate_hz, or a column image"):
        footage_of(tmp_path / "a").times_s()


def test_every_kind_of_image_becomes_rgb(tmp_path):
    grey, folder = picture(100)[..., 0], tmp_path / "a"
    turned = Image.Exif()
    turned[0x0112] = 6  # on its side: to be turned clockwise
    save(folder, "0.jpg", np.rot90(picture(100)), exif=turned, quality=95)
    save(folder, "1.png", grey)
    save(folder, "2.png", np.dstack([picture(100), np.full_like(grey, 7)]))
    save(folder, "3.png", Image.fromarray(grey.astype(np.uint16) * 256))
    images = [*footage_of(folder).images(range(4))]
    assert {image.shape for image in images} == {(48, 64, 3)}
    for image in images:
        assert np.abs(image.astype(int) - picture(100)).max() <= 3


def test_what_cannot_be_is_refused_by_its_name(tmp_path):
    def told(path):
        with pytest.raises(UserError) as refusal:
            [*footage_of(path).images([0, 1])]
        assert "\n" not in str(refusal.value)
        return str(refusal.value)

    folder = tmp_path / "a"
    folder.mkdir()
    assert "has no image" in told(folder)
    assert "none.mp4 is not there" in told(tmp_path / "none.mp4")
    save(folder, "0.png", picture(0))
    (folder / "1.png").touch()
    assert "1.png is empty" in told(folder)
    (folder / "1.png").write_bytes(b"no image")
    assert "1.png cannot be read" in told(folder)
    save(folder, "1.png", np.zeros((4, 4, 3), np.uint8))
    assert "0.png has 64x48 pixels, and" in told(folder)
    assert "1.png 4x4" in told(folder)
    save(folder, "1.png", picture(0))
    whole = (folder / "1.png").read_bytes()
    (folder / "1.png").write_bytes(whole[: len(whole) // 2])
    assert "1.png cannot be read" in told(folder)


@pytest.mark.parametrize("content", [b"", b"no video", None])
def test_a_broken_video_is_refused_in_one_line(tmp_path, content):
    """In a process of its own: FFmpeg is told to be quiet before it is loaded."""
    whole = write_video(tmp_path / "a.mp4").read_bytes()
    (tmp_path / "b.mp4").write_bytes(whole[: len(whole) // 2] if content is None else content)
    code = "import sys, pathlib; from src.data.footage import footage_of as read\n"
    code += "try: read(pathlib.Path(sys.argv[1]))\nexcept Exception as error: print(error)"
    command = [sys.executable, "-c", code, str(tmp_path / "b.mp4")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    assert "b.mp4 has no frame that OpenCV can read" in done.stdout


def test_without_opencv_the_way_out_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    (tmp_path / "a.mp4").touch()
    with pytest.raises(
        UserError, match=r"video: needs cv2; .*\[video\]', or give a folder of images"
    ):
        footage_of(tmp_path / "a.mp4")
