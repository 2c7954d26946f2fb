"""The data set as the trainer sees it: loaders for the parts of the temporal split."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from jaxtyping import Float, UInt8
from lightning import LightningDataModule
from rich.progress import track
from torch import Tensor
from torch.utils.data import DataLoader

from ..errors import UserError
from ..geometry import VoxelGrid
from .clip import Clip
from .dataset import EpochSampler, OccupancyDataset, velocity_world_mps
from .manifest import read_manifest
from .split import make_split


class SkyShieldData(LightningDataModule):
    """Loads a finished data set; it needs neither the simulator nor its configuration.

    Images stay uint8 until they are on the device. Raises `UserError` where the data set is
    incomplete, a file is broken, the split leaves a part without a frame, or the grid has no left
    and right to swap.
    """

    def __init__(
        self,
        root: Path,
        val_clips: Sequence[str],
        test_clips: Sequence[str],
        frames: int,
        history_step_s: float,
        history: str,
        mirror: bool,
        batch_size: int,
        workers: int,
        seed: int,
    ) -> None:
        super().__init__()
        self.root = Path(root)
        self.val_clips, self.test_clips = tuple(val_clips), tuple(test_clips)
        self.frames, self.history_step_s, self.history = frames, history_step_s, history
        self.mirror, self.batch_size, self.workers, self.seed = mirror, batch_size, workers, seed
        clip_ids = list(read_manifest(self.root)["clips"])
        self.clips = {clip_id: Clip(self.root / clip_id) for clip_id in clip_ids}
        first = self.clips[clip_ids[0]]
        self.split = make_split(
            clip_ids, len(first), first.meta.capture_hz, self.val_clips, self.test_clips
        )
        for part, samples in self.split.items():
            if not samples:
                raise UserError(f"data.val_clips/data.test_clips: they leave no frame for {part}")
        if mirror and self.grid.lower_m[1] != -self.grid.upper_m[1]:
            raise UserError(
                "data.mirror: the grid reaches further to one side, so labels cannot be mirrored; "
                "set data.mirror=false"
            )

    @property
    def grid(self) -> VoxelGrid:
        return next(iter(self.clips.values())).meta.grid

    def dataset(self, part: str) -> OccupancyDataset:
        """The samples of ``train``, ``val`` or ``test``."""
        return OccupancyDataset(
            self.clips,
            self.split[part],
            self.frames,
            self.history_step_s,
            self.history,
            held_out=self.val_clips + self.test_clips,
        )

    def train_dataloader(self) -> DataLoader:
        dataset = self.dataset("train")
        sampler = EpochSampler(len(dataset), self.seed, self.mirror)
        return self._loader(dataset, sampler=sampler, drop_last=len(dataset) >= self.batch_size)

    def val_dataloader(self) -> DataLoader:
        return self.in_order("val")

    def test_dataloader(self) -> DataLoader:
        return self.in_order("test")

    def in_order(self, part: str) -> DataLoader:
        """Every frame of a part once, clip by clip."""
        return self._loader(self.dataset(part))

    def labels(self, part: str) -> Iterator[tuple[UInt8[Tensor, "X Y Z"], Float[Tensor, "3"]]]:
        """Labels and world velocity in m/s of every frame of a part, without its images."""
        quiet = not sys.stdout.isatty()
        samples = track(self.split[part], f"reading {part} labels", transient=True, disable=quiet)
        for clip_id, frame in samples:
            clip = self.clips[clip_id]
            yield torch.from_numpy(clip.semantics(frame)), velocity_world_mps(clip, frame)

    def _loader(self, dataset: OccupancyDataset, **options: object) -> DataLoader:
        return DataLoader(
            dataset,
            batch_size=self.batch_size,
            num_workers=self.workers,
            persistent_workers=self.workers > 0,
            **options,
        )
