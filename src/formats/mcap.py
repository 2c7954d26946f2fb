"""MCAP: labels, images, poses and the camera over time, for Foxglove, Lichtblick and ROS 2 tools.

The messages are Foxglove's own types, in protobuf. A voxel's cell has five bytes: red, green, blue,
alpha and the id of its class. Free and unknown voxels are transparent, and keep their ids.
"""

import io
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from ..atomic import replacing
from ..errors import UserError, import_extra, reason_of
from ..geometry import Array, VoxelGrid, world_from_occ
from ..ontology import CLASSES, COLORS, FREE

FIELDS = ("red", "green", "blue", "alpha", "class_id")
JPEG_QUALITY = 90
# Foxglove's cameras are OpenCV's, whose first pixel has its center at (0, 0).
OURS_FROM_OPENCV_PIX = 0.5


class McapWriter:
    """Writes frames to one MCAP file, which has its name when the block is left without an error.

    Args:
        path: the file, which is replaced where there is one.
        grid: of all labels, in the frame ``occ``.
        body_from_camera: the camera's mount, 4x4.
        pix_from_camera: the intrinsics, 3x3, with (0.5, 0.5) as the center of the first pixel.
        size_pix: width and height of the images.

    Raises `UserError` where foxglove-sdk is not installed.
    """

    def __init__(
        self,
        path: Path,
        grid: VoxelGrid,
        body_from_camera: Float[Array, "4 4"],
        pix_from_camera: Float[Array, "3 3"],
        size_pix: tuple[int, int],
    ) -> None:
        self.path, self.grid, self.size_pix = Path(path), grid, size_pix
        self._sdk = import_extra("foxglove", "view", str(path))
        self._body_from_camera = np.asarray(body_from_camera, np.float64)
        self._pix_from_camera = np.asarray(pix_from_camera, np.float64)

    def __enter__(self) -> "McapWriter":
        # A context of its own keeps apart the channels of two files that are open at once.
        self._context, self._channels = self._sdk.Context(), {}
        self._stack = ExitStack()
        temporary = self._stack.enter_context(replacing(self.path))
        file = self._sdk.open_mcap(temporary, allow_overwrite=True, context=self._context)
        self._stack.enter_context(file)
        return self

    def __exit__(self, *failure: object) -> bool | None:
        try:
            return self._stack.__exit__(*failure)
        except RuntimeError as error:  # what the library raises where its disk is full
            raise UserError(
                f"{self.path}: cannot be written ({reason_of(error)}); free some space or choose "
                "another folder"
            ) from error

    def add(
        self,
        time_s: float,
        world_from_body: Float[Array, "4 4"],
        labels: Mapping[str, UInt8[Array, "X Y Z"]],
        image: UInt8[np.ndarray, "h w 3"] | None = None,
    ) -> None:
        """Adds a frame: its pose, its image if any, and each of its labels, as ``/<name>``.

        Raises `UserError` for labels of another grid.
        """
        self._time_ns = round(time_s * 1e9)
        world_from_body = np.asarray(world_from_body, np.float64)
        self._log_transform("world", "body", world_from_body)
        self._log_transform("body", "camera", self._body_from_camera)
        self._log_transform("world", "occ", world_from_occ(world_from_body))

        self._log_calibration()
        if image is not None:
            encoded = io.BytesIO()
            Image.fromarray(image).save(encoded, "JPEG", quality=JPEG_QUALITY, subsampling=0)
            content = {"frame_id": "camera", "format": "jpeg", "data": encoded.getvalue()}
            self._log("/camera/image", "CompressedImage", **content)
        for name, each in labels.items():
            self._log_voxels(name, np.asarray(each))

    def _log(self, topic: str, kind: str, **content: object) -> None:
        """Writes a message of a kind to the topic's channel."""
        if topic not in self._channels:
            channel = getattr(self._sdk.channels, f"{kind}Channel")
            self._channels[topic] = channel(topic, context=self._context)
        sec, nsec = divmod(self._time_ns, 10**9)
        stamp = self._sdk.messages.Timestamp(sec=sec, nsec=nsec)
        message = getattr(self._sdk.messages, kind)(timestamp=stamp, **content)
        self._channels[topic].log(message, log_time=self._time_ns)

    def _log_transform(
        self, parent: str, child: str, parent_from_child: Float[np.ndarray, "4 4"]
    ) -> None:
        self._log(
            "/tf",
            "FrameTransform",
            parent_frame_id=parent,
            child_frame_id=child,
            translation=self._vector(parent_from_child[:3, 3]),
            rotation=self._quaternion(quat_from_rotation(parent_from_child[:3, :3])),
        )

    def _log_calibration(self) -> None:
        intrinsics = self._pix_from_camera.copy()
        intrinsics[:2, 2] -= OURS_FROM_OPENCV_PIX
        matrices = {"K": intrinsics, "R": np.eye(3), "P": np.pad(intrinsics, ((0, 0), (0, 1)))}
        self._log(
            "/camera/calibration",
            "CameraCalibration",
            frame_id="camera",
            width=self.size_pix[0],
            height=self.size_pix[1],
            **{name: matrix.flatten().tolist() for name, matrix in matrices.items()},
        )

    def _log_voxels(self, name: str, labels: UInt8[np.ndarray, "X Y Z"]) -> None:
        if labels.shape != self.grid.shape:
            raise UserError(
                f"{self.path}: {name} is {list(labels.shape)}, and the grid is "
                f"{list(self.grid.shape)}; give labels of this grid"
            )

        sdk, (columns, rows, _), stride = self._sdk.messages, self.grid.shape, len(FIELDS)
        uint8, level = sdk.PackedElementFieldNumericType.Uint8, self._quaternion([0, 0, 0, 1])
        self._log(
            f"/{name}",
            "VoxelGrid",
            frame_id="occ",
            pose=sdk.Pose(position=self._vector(self.grid.lower_m), orientation=level),
            cell_size=self._vector([self.grid.voxel_m] * 3),
            row_count=rows,
            column_count=columns,
            cell_stride=stride,
            row_stride=stride * columns,
            slice_stride=stride * columns * rows,
            fields=[
                sdk.PackedElementField(name=each, offset=offset, type=uint8)
                for offset, each in enumerate(FIELDS)
            ],
            # x runs fastest, then y, then z.
            data=CELLS[labels.transpose(2, 1, 0)].tobytes(),
        )

    def _vector(self, xyz: Sequence[float] | np.ndarray) -> object:
        return self._sdk.messages.Vector3(**dict(zip("xyz", map(float, xyz))))

    def _quaternion(self, xyzw: Sequence[float] | np.ndarray) -> object:
        return self._sdk.messages.Quaternion(**dict(zip("xyzw", map(float, xyzw))))


def quat_from_rotation(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Returns the unit quaternion ``xyzw`` of a rotation, also where Euler angles have none.

    It is the eigenvector of the largest eigenvalue of a symmetric matrix (Bar-Itzhack, 2000).
    """
    skew = rotation - rotation.T
    symmetric = np.empty((4, 4))
    symmetric[:3, :3] = rotation + rotation.T - np.trace(rotation) * np.eye(3)
    symmetric[3, :3] = symmetric[:3, 3] = skew[2, 1], skew[0, 2], skew[1, 0]
    symmetric[3, 3] = np.trace(rotation)
    return np.linalg.eigh(symmetric)[1][:, -1]


def _cells() -> UInt8[np.ndarray, "256 5"]:
    """Returns the cell of every id."""
    cells = np.zeros((256, len(FIELDS)), np.uint8)
    cells[:, -1] = np.arange(256)
    cells[:FREE, :3] = [COLORS[name] for name in CLASSES[:FREE]]
    cells[:FREE, 3] = 255
    return cells


CELLS = _cells()
