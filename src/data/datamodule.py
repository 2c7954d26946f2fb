"""The dataset as the trainer sees it: loaders for the parts of the temporal split."""

from collections.abc import Iterator, Sequence
from multiprocessing import get_all_start_methods
from pathlib import Path

import torch
from jaxtyping import Float, UInt8
from lightning import LightningDataModule
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from ..errors import UserError
from ..geometry import VoxelGrid
from ..limits import require_choice
from ..parallax import Parallax
from ..terminal import tracked
from .batches import ALONE, ORDERS, BatchesInOrder, Rank, StreamBatches, TrainingBatches
from .clip import AUX, Clip
from .dataset import OccupancyDataset, velocity_world_mps
from .manifest import missing_clips, read_manifest
from .split import make_split
from .volumes import keep_volumes

# A frame's labels, the UAV's velocity in the world, and its height in voxels.
LabelledFrame = tuple[UInt8[Tensor, "X Y Z"], Float[Tensor, "3"], int]


class SkyShieldData(LightningDataModule):
    """Loads a finished dataset; it needs neither the simulator nor its configuration.

    Images stay uint8 until they are on the device. ``order`` is that of training: ``"shuffled"``
    frames, each with the images of its whole history, or ``"streams"`` of consecutive ones
    (`StreamBatches`), each with its own image alone. With ``pixels`` the frames to train and to
    validate on hold what their pixels see. With ``allow_missing`` the frames of clips
    that are not on the disk are left out, and ``missing`` names these clips. Raises `UserError` for
    another ``order``, and where the dataset is incomplete, a file is broken, the split leaves a
    part without a frame, or the grid has no left and right to swap.
    """

    def __init__(
        self,
        root: Path,
        val_clips: Sequence[str],
        test_clips: Sequence[str],
        frames: int,
        history_step_s: float,
        history: str,
        order: str,
        run_frames: int,
        mirror: bool,
        batch_size: int,
        workers: int,
        seed: int,
        pixels: bool = False,
        parallax: Parallax | None = None,
        allow_missing: bool = False,
    ) -> None:
        super().__init__()
        require_choice("data.order", order, ORDERS)
        self.root = Path(root)
        self.held_out = (*val_clips, *test_clips)
        self.frames, self.history_step_s, self.history = frames, history_step_s, history
        self.pixels, self.parallax = pixels, parallax
        self.order, self.run_frames = order, run_frames
        self.mirror, self.batch_size, self.workers, self.seed = mirror, batch_size, workers, seed

        manifest = read_manifest(self.root)
        clip_ids = list(manifest["clips"])
        self.missing = missing_clips(self.root, clip_ids) if allow_missing else []
        present = [clip_id for clip_id in clip_ids if clip_id not in self.missing]
        if not present:
            raise UserError(f"{self.root}: none of its clips is there; run task=generate")
        self.clips = {clip_id: Clip(self.root / clip_id) for clip_id in present}

        # Clips that are missing count as well: the split must not depend on what is here.
        first = self.clips[present[0]]
        split = make_split(clip_ids, len(first), first.meta.capture_hz, val_clips, test_clips)
        self.split = {}
        for part, samples in split.items():
            # A dataset to score on alone says itself that it has no other part.
            if not samples and manifest["split"].get(part) != 0:
                raise UserError(f"data.val_clips/data.test_clips: they leave no frame for {part}")
            self.split[part] = [sample for sample in samples if sample[0] in self.clips]

        # A mirrored voxel must be a voxel of the same grid.
        if mirror and self.grid.lower_m[1] != -self.grid.upper_m[1]:
            raise UserError(
                "data.mirror: the grid reaches further to one side, so labels cannot be mirrored; "
                "set data.mirror=false"
            )

    @property
    def grid(self) -> VoxelGrid:
        return next(iter(self.clips.values())).meta.grid

    def dataset(self, part: str, images: bool = True, pixels: bool = False) -> OccupancyDataset:
        """Returns the samples of a part of the split, as `OccupancyDataset` has them.

        Raises `UserError` for a part that has none.
        """
        if not self.split[part]:
            raise UserError(f"{self.root}: has no {part} frame; it is a dataset to score on")
        window = self.frames, self.history_step_s, self.history, self.held_out
        wanted = images, pixels, self.parallax
        return OccupancyDataset(self.clips, self.split[part], *window, *wanted)

    def prepare_data(self) -> None:
        """Keeps the cost volumes of all frames, so that each is computed once."""
        if self.parallax is not None:
            keep_volumes(self.parallax, list(self.clips.values()))

    def train_dataloader(self) -> DataLoader:
        dataset = self.dataset("train", self.order == "shuffled", self.pixels)
        drawing = self.batch_size, self.seed, self.mirror, self._rank()
        if self.order == "shuffled":
            return self._loader(dataset, TrainingBatches(len(dataset), *drawing))
        batches = StreamBatches(dataset.samples, dataset.step, self.run_frames, *drawing)
        return self._loader(dataset, batches)

    def val_dataloader(self) -> DataLoader:
        return self.in_order("val", self.pixels)

    def test_dataloader(self) -> DataLoader:
        return self.in_order("test")

    def in_order(self, part: str, pixels: bool = False) -> DataLoader:
        """Loads every frame of a part once, clip by clip; several processes share the frames."""
        dataset = self.dataset(part, pixels=pixels)
        return self._loader(dataset, BatchesInOrder(len(dataset), self.batch_size, self._rank()))

    def require_pixels(self) -> None:
        """Raises `UserError` where the pixels of a frame to train on are to be labelled, and its
        clip does not say what they see."""
        if self.pixels and not all((clip.folder / AUX).is_file() for clip in self.clips.values()):
            raise UserError(
                f"model/sight: on, and {self.root} has clips without {AUX}; generate it with "
                "sim.save_aux=true, or give model/sight=off model/parallax=off model/evidence=off"
            )

    def labels(self, part: str) -> Iterator[LabelledFrame]:
        """Yields the labels of every frame of a part, without its images."""
        for clip_id, frame in tracked(self.split[part], f"reading {part} labels"):
            clip = self.clips[clip_id]
            semantics = torch.from_numpy(clip.semantics(frame))
            yield semantics, velocity_world_mps(clip, frame), self.layer(clip_id, frame)

    def layer(self, clip_id: str, frame: int) -> int:
        """Returns the UAV's height above the world's ground plane in voxels, rounded."""
        height_m = self.clips[clip_id].world_from_body[frame, 2, 3]
        return round(float(height_m) / self.grid.voxel_m)

    def _rank(self) -> Rank:
        trainer = self.trainer
        return ALONE if trainer is None else Rank(trainer.global_rank, trainer.world_size)

    def _loader(self, dataset: Dataset, batches: TrainingBatches | BatchesInOrder) -> DataLoader:
        """Loads a dataset's batches with the configured workers."""
        return DataLoader(
            dataset,
            batch_sampler=batches,
            num_workers=self.workers,
            persistent_workers=self.workers > 0,
            # The platform's own: in a job of joblib's launcher the default is joblib's, which can
            # start no loader's workers.
            multiprocessing_context=get_all_start_methods()[0] if self.workers else None,
        )
