"""Where labels of VRUs and visible actors are lost, and what each remedy would change.

    python -m studies.world.lost_labels [--clips CLIP...] [--every N] [--out FILE] [OVERRIDE...]

Makes some clips again in memory, and compares every ``--every``-th frame's labels with the surfaces
of the scene. A remedy is another election, or other settings of ``sim``; what it changes is printed
in a row, with ``--out`` in a table too. Nothing of a dataset is written.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from omegaconf import OmegaConf

from src.data.actors import MIN_VISIBLE_SHARE
from src.ontology import CLASSES, FREE, UNKNOWN, VRU
from src.results.files import write_table
from src.sim import annotation
from src.sim.clip_maker import ClipMaker
from src.sim.observation import Observation
from src.sim.plan import plan_clips
from src.sim.voxel_kernels import elect
from src.terminal import say, tracked
from studies.settings import composed, run
from studies.tables import print_table
from studies.world.agreement import SurfaceAgreement
from studies.world.truth import Camera, SurfaceTruth

Elect = Callable[[np.ndarray, np.ndarray], np.ndarray]

TYPES = ("car", "bicycle")
COLUMNS = ("remedy", "found", "named", "named_visible", "precision", "ground_named", "cars")
COLUMNS += ("bicycles",)


def first_with(share: float, votes: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Elects as usual, but a voxel is a VRU's where it has that share of the votes, and one."""
    enough = (votes[..., VRU] > 0) & (votes[..., VRU] >= share * votes.sum(axis=-1))
    return np.where(enough, np.uint8(VRU), elect(votes, free))


# By name: settings of sim, and the election.
REMEDIES: Mapping[str, tuple[Mapping, Elect]] = {
    "as published": ({}, elect),
    "a third of the votes is a VRU's": ({}, partial(first_with, 1 / 3)),
    "any vote is a VRU's": ({}, partial(first_with, 0.0)),
    "LiDAR at 20 Hz": ({"lidar_hz": 20}, elect),
    "8 cars and 2 bicycles for 6 and 3": (
        {
            "traffic": {
                "counts": {
                    "car": 8,
                    "truck": 2,
                    "bus": 2,
                    "pedestrian": 2,
                    "bicycle": 2,
                    "motorcycle": 4,
                }
            }
        },
        elect,
    ),
}


class Losses:
    """What becomes of the voxels that truly hold a VRU, and how many actors a frame shows."""

    def __init__(self) -> None:
        self.agreement, self.labels = SurfaceAgreement(), Counter()
        self.actors: Counter = Counter()

    def add(self, maker: ClipMaker, seen: Observation, frame: int) -> None:
        view, step = seen.views[frame], maker.step_of(frame)
        semantics = maker.label(seen, frame).semantics
        mount = maker.body_from_camera, maker.pix_from_camera, *maker.size
        camera = Camera(view.world_from_body, *mount)
        truth = SurfaceTruth.of(seen.recording.scene, step, camera, maker.grid)
        self.agreement.add(semantics, truth)
        held = truth.holds[..., VRU] & (semantics != UNKNOWN)
        self.labels.update(semantics[held].tolist())

        enough = MIN_VISIBLE_SHARE * maker.size[0] * maker.size[1]
        supported = [
            actor
            for actor in seen.recording.actors
            if annotation.is_supported(actor, view, seen.lidar_returns[frame])
        ]
        for actor in seen.recording.actors:
            pixels = view.visible_pixels.get(actor.actor_id, 0)
            middle_m = actor.world_from_actor[step][:3, 3] + (0, 0, actor.size_m[2] / 2)
            corner = view.camera_from_occ.numpy() @ view.occ_from_world @ (*middle_m, 1.0)
            u, v = (view.pix_from_camera.numpy() @ corner[:3])[:2] / corner[2]
            ahead = corner[2] > 0 and 0 <= u < maker.size[0] and 0 <= v < maker.size[1]
            self.actors[actor.type, "in the scene"] += 1
            self.actors[actor.type, "in the image"] += bool(ahead)
            self.actors[actor.type, "in the image within 50 m"] += bool(ahead and corner[2] < 50)
            self.actors[actor.type, "a pixel or more"] += pixels > 0
            self.actors[actor.type, "visible"] += pixels >= enough
            self.actors[actor.type, "with points"] += actor in supported

    def row(self, name: str) -> tuple:
        table = self.agreement.table().set_index(["scope", "class"])
        own, ground = table.loc["supervised", "vru"], table.loc["supervised", "ground"]
        visible = table.loc["visible", "vru"]
        shares = own["recall"], own["class_recall"], visible["class_recall"]
        shares = (*shares, own["class_precision"], ground["class_recall"])
        seen = (self.actors[kind, "visible"] / self.agreement.frames for kind in TYPES)
        return name, *(round(float(each), 3) for each in shares), *(round(n, 2) for n in seen)


def main(
    *overrides: str,
    clips: tuple[str, ...] = ("downtown/clip00", "market/clip01"),
    every: int = 3,
    out: Path | None = None,
) -> None:
    cfg = composed(["task=generate", *overrides])
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    chosen = [plan for plan in plan_clips(sim) if plan.clip_id in clips]
    rows = []
    for name, (settings, election) in tracked(REMEDIES.items(), "trying"):
        losses, maker = Losses(), ClipMaker({**sim, **settings}, Path())
        with patch.object(annotation, "elect", election):
            for plan in chosen:
                seen = maker.observe(plan, lambda *each: None)
                for frame in range(0, len(seen.views), every):
                    losses.add(maker, seen, frame)
        rows.append(losses.row(name))
        if not settings and election is elect:
            tell(losses)
    print_table(f"VRUs in {', '.join(clips)}", COLUMNS, [tuple(map(str, row)) for row in rows])
    if out is not None:
        write_table(pd.DataFrame(rows, columns=COLUMNS), out)


def tell(losses: Losses) -> None:
    """Prints what the voxels that truly hold a VRU are labelled, and how many actors are where."""
    total = sum(losses.labels.values())
    for label, count in losses.labels.most_common():
        name = CLASSES[label] if label <= FREE else "unknown"
        say(f"voxels with a VRU that are labelled {name}: {count / total:.1%}")
    for (kind, where), count in sorted(losses.actors.items()):
        if kind in TYPES:
            say(f"{kind} {where}: {count / losses.agreement.frames:.2f} a frame")


if __name__ == "__main__":
    run(main)
