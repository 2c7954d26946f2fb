"""Scores of a flight's beliefs, frame by frame, as in offline evaluation."""

import math
from collections.abc import Mapping

import numpy as np
import torch

from ..data.rates import STEP_HZ
from ..geometry import VoxelGrid, camera_from_occ, world_from_occ
from ..loop.flight import Moment
from ..loop.perception import Perception, seen_by
from ..loop.stage import Stage
from ..metrics.protocol import Protocol
from ..metrics.suite import ScoreSuite, import_metrics
from ..ontology import FREE
from .counts import Counts

MASK = "voxels that the camera truly sees"


class FrameScores:
    """Watches a flight, and scores all beliefs against the truth of the scene.

    It counts the voxels in the camera's view that nothing truly hides, even if a predicted obstacle
    would hide them. With a ``perception``, its beliefs are scored along a flight that another
    perception flies. ``config`` is the composed configuration.
    """

    def __init__(self, stage: Stage, config: Mapping, perception: Perception | None = None) -> None:
        self._grid, self._truth = VoxelGrid(**config["task"]["grid"]), stage.truth
        self._config, self._perception = config, perception
        image = config["sim"]["image"]
        self._size_pix = image["width"], image["height"]
        self._frames: list[tuple[float, dict[str, torch.Tensor]]] = []
        if perception:
            perception.begin(stage.truth, stage.mission.flight)

    def __call__(self, moment: Moment) -> None:
        frame = moment.frame
        belief = self._perception(frame) if self._perception else moment.belief
        matrix = world_from_occ(frame.world_from_body)
        truth, _ = self._truth.at(round(frame.time_s * STEP_HZ), matrix, self._grid)
        seen = seen_by(frame, self._grid, truth != FREE)

        chain = camera_from_occ(torch.from_numpy(frame.world_from_body), frame.body_from_camera)
        arrays = {
            **{"preds": belief.semantics, "semantics": truth, "mask": seen, "visible": seen},
            "occupied": np.asarray(belief.occupied, np.float32),
            "velocity_mps": matrix[:3, :3].T @ frame.velocity_mps,
        }
        scored = {name: torch.from_numpy(array) for name, array in arrays.items()}
        scored |= {"camera_from_occ": chain, "pix_from_camera": frame.pix_from_camera}
        self._frames.append((frame.time_s, scored))

    def counts(self, flight: str) -> Counts:
        """Returns the tables of every second of the flight, the first one first."""
        # A frame's time is a sum of steps, which may end just below a whole second.
        seconds = [math.floor(time_s + 1e-6) for time_s, _ in self._frames]
        frames = [seconds.count(second) for second in range(seconds[-1] + 1)]
        clips = [f"{flight}@{second}" for second in range(len(frames))]

        metrics = self._config["suite"]["metrics"]
        # It takes logits.
        kept = {name: each for name, each in metrics.items() if name != "calibration"}
        settings = self._config["metric"], {**self._config["suite"], "metrics": kept}
        protocol = Protocol.of("flights", "flown", len(seconds), self._grid, MASK, *settings)
        import_metrics(protocol.suite)
        suite = ScoreSuite.of(protocol, clips)
        # One at a time: all frames of a flight would take much memory.
        for second, (_, frame) in zip(seconds, self._frames):
            batch = {name: tensor[None] for name, tensor in frame.items()}
            truth = {**batch, "clip": [clips[second]], "size_pix": self._size_pix}
            suite.update(truth.pop("preds"), truth)
        return Counts(flight, protocol, clips, frames, suite.counts())
