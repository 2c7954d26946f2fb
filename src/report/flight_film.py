"""A flight as a looping picture: the camera with the plan in it, the truth, and the belief."""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

from ..data.rates import STEP_HZ
from ..formats.mcap import McapWriter
from ..geometry import VoxelGrid, camera_from_occ, inverse, transform, world_from_occ
from ..loop.flight import Moment
from ..loop.perception import seen_by
from ..loop.planner import Plan
from ..loop.stage import Stage
from ..models.frame import StreamFrame
from ..ontology import CLASSES, FREE, UNKNOWN
from ..results.render import Table
from .animation import draw_scenes
from .canvas import Pixels
from .report_page import write_page
from .scene import VoxelScene
from .view import Frustum

# The end of a flight is shown, and its last picture stays.
SHOWN, FRAME_MS, LAST_MS = 22, 200, 2000
# In a color that no class has, nor the frustum.
DOTS, DOT_PIX, DOT_RGB = 24, 1.5, (255, 0, 160)
BELIEF = "Belief"
INVENTED = {"general": "general / none"}
# What the page tells of a flight.
FACTS = ("town", "stratum", "outcome", "hit", "fault", "time_s", "clearance_m", "regret_m")


class Film:
    """Watches a flight, and draws it.

    ``threshold`` is the probability from which a voxel is shown as occupied. A belief has no
    classes: it takes those of the truth, and where that is free, the general one. Both volumes
    show what is in the camera's view and not hidden by what is believed.
    """

    def __init__(self, stage: Stage, grid: VoxelGrid, threshold: float) -> None:
        self._stage, self._grid, self._threshold = stage, grid, threshold
        self._scenes: list[VoxelScene] = []
        self._frames: list[StreamFrame] = []

    def __call__(self, moment: Moment) -> None:
        frame, belief, grid = moment.frame, moment.belief, self._grid
        matrix = world_from_occ(frame.world_from_body)
        truth, _ = self._stage.truth.at(round(frame.time_s * STEP_HZ), matrix, grid)

        occupied = (belief.occupied > self._threshold) & belief.known
        invented = np.where(truth == FREE, np.uint8(CLASSES.index("general")), truth)
        seen = seen_by(frame, grid, occupied)
        chain = camera_from_occ(torch.from_numpy(frame.world_from_body), frame.body_from_camera)
        camera = Frustum(chain, frame.pix_from_camera, tuple(frame.image.shape[:-3:-1]))
        image = np.asarray(frame.image).transpose(1, 2, 0)
        scene = VoxelScene(
            title=f"{frame.time_s:.1f} s",
            grid=grid,
            image=_with_plan(image, moment.plan, matrix, camera),
            truth=np.where(seen, truth, np.uint8(UNKNOWN)),
            predictions={BELIEF: np.where(occupied, invented, np.uint8(FREE))},
            frustum=camera,
        )
        self._scenes.append(scene)
        self._frames.append(frame)

    def write(self, path: str | Path, row: Mapping[str, object]) -> None:
        """Writes the end of the flight as a GIF of at most 1 MB, which tells the time and, at the
        end, the outcome in its ``row``; beside it a page on which it turns, frame by frame; and the
        whole of it as MCAP where foxglove-sdk is installed."""
        shown = self._scenes[-SHOWN:]
        hit = f", {row['hit']}".replace("_", " ") if row["hit"] else ""
        end = f"{row['time_s']:.1f} s: {row['outcome']}{hit}"
        titles = [*(scene.title for scene in shown[:-1]), end]
        durations_ms = [FRAME_MS] * (len(shown) - 1) + [LAST_MS]
        draw_scenes(shown, durations_ms, path, titles, called=INVENTED)

        facts = {name.replace("_", " "): str(row[name]) for name in FACTS if row[name] != ""}
        rows = [(row["flight"], list(facts.values()))]
        table = Table("flight", "Flight", "", list(facts), rows, "Flight")
        heading = f"{row['perception']} on {row['flight']}"
        # Every second frame, with the last: a page of all would have ten megabytes.
        page = Path(path).with_suffix(".html")
        write_page(page, heading, {"Facts": [table]}, shown[::-2][::-1])
        if find_spec("foxglove"):
            self._record(Path(path).with_suffix(".mcap"))

    def _record(self, path: Path) -> None:
        first = self._frames[0]
        camera = first.body_from_camera, first.pix_from_camera, self._scenes[0].frustum.size_pix
        with McapWriter(path, self._grid, *camera) as recorder:
            for frame, scene in zip(self._frames, self._scenes):
                labels = {"truth": scene.truth, BELIEF.lower(): scene.predictions[BELIEF]}
                recorder.add(frame.time_s, frame.world_from_body, labels, scene.image)


def _with_plan(image: Pixels, plan: Plan, world_from_occ_: np.ndarray, camera: Frustum) -> Pixels:
    """Returns the image with the places of the plan as dots."""
    places_m = plan.at(np.linspace(0.1, 1.0, DOTS) * plan.duration_s)[:, :3]
    pix, depth_m = camera.project(torch.from_numpy(transform(inverse(world_from_occ_), places_m)))
    picture = Image.fromarray(np.ascontiguousarray(image))
    for (u, v), near_m in zip(pix.tolist(), depth_m.tolist()):
        if near_m > 0.3:
            corners = (u - DOT_PIX, v - DOT_PIX, u + DOT_PIX, v + DOT_PIX)
            ImageDraw.Draw(picture).ellipse(corners, fill=DOT_RGB)
    return np.asarray(picture)
