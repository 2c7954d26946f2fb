"""The front camera in flight: frames with an image, or with none for who does not look."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import torch

from ..data.rates import STEP_HZ
from ..models.frame import StreamFrame
from ..sim.air import apply_weather
from ..sim.clip_maker import ClipMaker
from ..sim.weather import Weather
from ..sim.world import World
from .airframe import VELOCITY, State, world_from_body
from .stage import Stage

Look = Callable[[float, State], StreamFrame]


class FlightCamera:
    """Takes the frames of flights; ``sim`` is the composed configuration of the simulation."""

    def __init__(self, sim: Mapping) -> None:
        maker = ClipMaker(sim, None)
        self._sim, self._size = sim, maker.size
        self._mount = maker.pix_from_camera, maker.body_from_camera

    @contextmanager
    def on(self, stage: Stage, wants_image: bool) -> Iterator[Look]:
        """Yields ``look(time_s, state) -> StreamFrame``. Images take most of the time: they are
        black where they are not wanted."""
        if not wants_image:
            black = np.zeros((3, *self._size[::-1]), dtype=np.uint8)
            yield lambda time_s, state: self._frame(black, time_s, state, stage)
            return

        weather = Weather.of(self._sim, stage.mission.weather)
        pix_from_camera, body_from_camera = self._mount
        with World(stage.scene, pix_from_camera, *self._size, self._sim["renderer"]) as world:

            def look(time_s: float, state: State) -> StreamFrame:
                world_from_camera = torch.from_numpy(world_from_body(state)) @ body_from_camera
                step = round(time_s * STEP_HZ)
                rendering = world.render(step, world_from_camera, weather)
                # Rain and noise are the frame's own, whatever came before.
                rng = stage.mission.rng("air", step)
                rgb = apply_weather(rendering, world_from_camera, pix_from_camera, weather, rng)
                return self._frame(rgb.transpose(2, 0, 1), time_s, state, stage)

            yield look

    def _frame(self, image: np.ndarray, time_s: float, state: State, stage: Stage) -> StreamFrame:
        matrix, flight = world_from_body(state), stage.mission.flight
        return StreamFrame(image, time_s, matrix, state[VELOCITY], *self._mount, flight)
