"""Footage: the images of a video, or of a folder, and when they were taken."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ..errors import UserError, import_extra
from ..terminal import metered, say
from .pictures import in_order, read_rgb, size_of

KINDS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
Pixels = UInt8[np.ndarray, "h w 3"]


def footage_of(path: Path) -> "Video | Pictures":
    """Opens a video, or a folder of images. Raises `UserError` for what is neither."""
    if not path.exists():
        raise UserError(f"video: {path} is not there; give a video or a folder of images")
    return Pictures(path) if path.is_dir() else Video(path)


class Video:
    """The frames of a video file, turned upright. Raises `UserError` where OpenCV reads none."""

    def __init__(self, path: Path) -> None:
        # Lines of its own about a broken file would stand before the one of the error.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
        self._cv2 = import_extra("cv2", "video", "video", ", or give a folder of images")
        self.path = path
        capture = self._opened()
        self._count = int(capture.get(self._cv2.CAP_PROP_FRAME_COUNT))
        is_there, first = capture.read()
        if not is_there or self._count < 1:
            raise UserError(f"video: {path} has no frame that OpenCV can read; encode it as mp4")
        self.size_pix = first.shape[1::-1]

    def times_s(self, rate_hz: float | None = None) -> Float[np.ndarray, "n"]:
        """Returns the times of the frames, from 0 s, at a rate or as the file has them.

        A telephone's frames are not evenly spaced, and only a walk through the file tells.
        """
        if rate_hz:
            return np.arange(self._count) / rate_hz
        capture, times_s = self._opened(), []
        with metered(f"reading the times of {self.path.name}", self._count) as meter:
            while capture.grab():
                times_s.append(capture.get(self._cv2.CAP_PROP_POS_MSEC) / 1000)
                meter.advance()
        return np.array(times_s) - times_s[0]

    def images(self, wanted: Sequence[int]) -> Iterator[Pixels]:
        """Yields the frames of these numbers, in order; fewer, and says so, where the file ends
        before."""
        capture, place = self._opened(), -1
        for number in wanted:
            while place < number and capture.grab():
                place += 1
            is_there, image = capture.retrieve() if place == number else (False, None)
            if not is_there:
                return say(f"{self.path}: ends at frame {place + 1} of {self._count}")
            yield np.ascontiguousarray(image[..., ::-1])

    def _opened(self) -> object:
        return self._cv2.VideoCapture(str(self.path), self._cv2.CAP_FFMPEG)


class Pictures:
    """The images of a folder, by name; all have one size.

    Raises `UserError` for a folder without images, for a file that is none, and for two sizes.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder
        images = (each for each in folder.iterdir() if each.suffix.lower() in KINDS)
        self._files = sorted(images, key=in_order)
        if not self._files:
            raise UserError(f"video: {folder} has no image ({', '.join(KINDS)})")
        self.size_pix = size_of(self._files[0])
        for file in self._files:
            if (size := size_of(file)) != self.size_pix:
                raise UserError(
                    f"video: {self._files[0]} has {'x'.join(map(str, self.size_pix))} pixels, and "
                    f"{file} {'x'.join(map(str, size))}; give images of one camera"
                )

    def times_s(self, rate_hz: float | None = None) -> Float[np.ndarray, "n"]:
        """Returns the times of the images: from 0 s at a rate, or else their names, in seconds.

        Raises `UserError` for names that are no times.
        """
        if rate_hz:
            return np.arange(len(self._files)) / rate_hz

        way_out = "give task.rate_hz, or a column image in the poses"
        stems = [file.stem for file in self._files]
        try:
            # Python would read 0001_0.10 as 10.1.
            times_s = np.array([float(stem.replace("_", " ")) for stem in stems])
        except ValueError:
            raise UserError(f"video: names like {self._files[0]} are no times; {way_out}") from None
        if not any("." in stem for stem in stems):
            raise UserError(f"video: {self._files[0]}: a frame's number is no time; {way_out}")

        # Without leading zeros, the order of names is not that of their numbers.
        order = np.argsort(times_s, kind="stable")
        self._files = [self._files[n] for n in order]
        return times_s[order]

    def keep(self, names: Sequence[str]) -> None:
        """Keeps the images of these names, in this order. Raises `UserError` for one that is not
        there."""
        there = {file.name: file for file in self._files}
        for name in names:
            if name not in there:
                raise UserError(f"poses: column image names {name}, which {self.path} has not")
        if left := len(there) - len({*names}):
            say(f"{self.path}: {left} images are not in the column image and are left out")
        self._files = [there[name] for name in names]

    def images(self, wanted: Sequence[int]) -> Iterator[Pixels]:
        """Yields the images of these places as RGB. Raises `UserError` for a broken one."""
        for number in wanted:
            yield read_rgb(self._files[number])
