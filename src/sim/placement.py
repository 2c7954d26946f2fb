"""Where the actors of a clip start: where the flight's camera will look at them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from .actor import HABITS, Actor
from .footprint import boxes_overlap
from .junction import STOP_SHORT_M, passages_of
from .layout import Path, Town
from .pilot import STEP_S
from .route import Route, chain
from .solid import Rng
from .towns.polyline import arc_m, heading_at, point_at

Points = Float[np.ndarray, "*s 2"]
Values = Float[np.ndarray, "*s"]
Flags = Bool[np.ndarray, "*s"]
Size = tuple[float, float, float]

START_GAP_M = 1.5
TRIES = 10
SPOT_M = 2.0

# The share of each type that keeps to the walks; every other actor takes the lanes.
WALKERS = {"pedestrian": 1.0, "bicycle": 0.3}

# By so much the sides of people may reach over the edge of a walk, which towns keep clear.
SHOULDER_M = 0.27


class Gaze:
    """Where a camera looks that faces the way the flight goes, every half second of it.

    It sees 45 degrees to each side and ``reach_m`` far. What hides an actor is not known here.
    """

    def __init__(self, uav_m: Float[np.ndarray, "t 3"], reach_m: float) -> None:
        every = round(0.5 / STEP_S)
        self.at_m = uav_m[::every, :2]
        self.time_s = np.arange(len(self.at_m)) * every * STEP_S
        self._reach_m = reach_m

        # While it hovers it looks where it last flew to.
        steps_m = np.gradient(self.at_m, axis=0) if len(self.at_m) > 1 else np.eye(1, 2)
        moves = np.linalg.norm(steps_m, axis=1) > 0.1
        moving = np.maximum.accumulate(np.where(moves, np.arange(len(steps_m)), 0))
        self._course_rad = np.arctan2(steps_m[moving, 1], steps_m[moving, 0])

    def share(self, points_m: Float[np.ndarray, "*s k 2"]) -> Values:
        """Returns the share of the flight during which things are in view that move as given."""
        offset_m = points_m - self.at_m
        bearing_rad = np.arctan2(offset_m[..., 1], offset_m[..., 0]) - self._course_rad
        in_view = np.cos(bearing_rad) > np.cos(np.pi / 4)
        in_view &= np.hypot(offset_m[..., 0], offset_m[..., 1]) < self._reach_m
        return in_view.mean(axis=-1)


@dataclass(frozen=True)
class Spots:
    """Places every 2 m along some paths: which path, how far along it, where, and facing where.

    ``junction_m`` is how far from the start of each path the junction reaches from which it comes.
    """

    paths: tuple[Path, ...]
    junction_m: Float[np.ndarray, "p"]
    index: Int[np.ndarray, "s"]
    arc_m: Float[np.ndarray, "s"]
    points_m: Float[np.ndarray, "s 2"]
    yaw_rad: Float[np.ndarray, "s"]

    @classmethod
    def near(cls, paths: tuple[Path, ...], way_m: Points, near_m: float) -> "Spots":
        """The spots no farther than ``near_m`` from somewhere on a way, and on no turn."""
        rows, junction_m = [np.zeros((0, 5))], _junction_ends_m(paths)
        for k, path in enumerate(paths):
            at_m = np.arange(SPOT_M / 2, path.length_m, SPOT_M)
            points_m, yaw_rad = _along(path, at_m)
            near = (np.linalg.norm(points_m[:, None] - way_m, axis=-1) < near_m).any(axis=1)
            near &= at_m > junction_m[k]
            rows.append(np.c_[np.full(len(at_m), k), at_m, points_m, yaw_rad][near])

        index, along_m, x_m, y_m, yaw_rad = np.concatenate(rows).T
        return cls(paths, junction_m, index.astype(int), along_m, np.c_[x_m, y_m], yaw_rad)

    def seen(self, speed_mps: float, gaze: Gaze) -> Values:
        """Returns how much is seen of an actor that starts at each spot and goes straight on."""
        shares = [np.zeros(0)]
        for k in np.unique(self.index):
            path, start_m = self.paths[k], self.arc_m[self.index == k]
            at_m = start_m[:, None] + min(speed_mps, path.speed_mps) * gaze.time_s
            shares.append(gaze.share(_along(path, at_m)[0]))
        return np.concatenate(shares)

    def free(self, size_m: Size, others: Sequence[Actor]) -> Flags:
        """Returns at which spots there is room for an actor of that size."""
        free = np.ones(len(self.index), dtype=bool)
        for other in others:
            free &= ~_crowded(self.points_m, self.yaw_rad, size_m, other)
        return free


def _junction_ends_m(paths: Sequence[Path]) -> Float[np.ndarray, "p"]:
    """How far along each path its junction reaches: the whole of a turn, none without a gate."""
    ends_m = np.zeros(len(paths))
    for path in paths:
        if path.gate is not None and not path.gate.is_crossing:
            for turn in path.successors:
                ends_m[turn] = np.inf
                ends_m[list(paths[turn].successors)] = path.gate.clear_m
    return ends_m


def _along(path: Path, at_m: Values) -> tuple[Points, Values]:
    """Points and headings of a path, which goes straight on after its end."""
    last_m = path.points_m[-1] - path.points_m[-2]
    beyond_m = np.maximum(at_m - arc_m(path.points_m)[-1], 0)[..., None]
    points_m = point_at(path.points_m, at_m) + beyond_m * last_m / np.linalg.norm(last_m)
    return points_m, heading_at(path.points_m, at_m)


class Placer:
    """Puts actors on a town's lanes and walks, one after another, where there is room.

    Spots are drawn by how much of what starts there the flight will see within ``seen_m``; where
    it sees none, nobody starts.
    """

    def __init__(
        self, town: Town, rng: Rng, uav_m: Float[np.ndarray, "t 3"], near_m: float, seen_m: float
    ) -> None:
        self._rng, self._duration_s = rng, (len(uav_m) - 1) * STEP_S
        self._gaze = Gaze(uav_m, seen_m)
        ways = {"lanes": town.lanes, "walks": town.walks}
        self._spots = {
            name: Spots.near(paths, self._gaze.at_m, near_m) for name, paths in ways.items()
        }
        self._seen: dict[tuple[str, str], np.ndarray] = {}

    def place(self, name: str, size_m: Size, placed: Sequence[Actor]) -> Actor | None:
        """Returns one more actor of a type and size, or None where no room is left."""
        ways = "walks" if self._rng.random() < WALKERS.get(name, 0.0) else "lanes"
        spots = self._spots[ways]
        if (ways, name) not in self._seen:
            speed_mps = float(np.mean(HABITS[name].speed_mps))
            self._seen[ways, name] = spots.seen(speed_mps, self._gaze)

        weight = self._seen[ways, name] * spots.free(size_m, placed)
        for _ in range(TRIES if weight.any() else 0):
            spot = int(self._rng.choice(len(weight), p=weight / weight.sum()))
            actor = self._set_out(name, size_m, ways, spot)
            if actor and not any(_crowded(*actor.start, size_m, each) for each in placed):
                return actor
        return None

    def _set_out(self, name: str, size_m: Size, ways: str, spot: int) -> Actor | None:
        """An actor that starts at a spot; None where the way ends there, and on junctions."""
        rng, spots, habits = self._rng, self._spots[ways], HABITS[name]
        first, start_m = int(spots.index[spot]), spots.arc_m[spot] + rng.uniform(-1, 1)
        half_m, speed_mps = size_m[0] / 2, rng.uniform(*habits.speed_mps)

        # The route is longer than the actor can get, so that it never comes to its end.
        ahead_m = start_m + speed_mps * self._duration_s + size_m[0] + 10
        middle = Route.through(chain(spots.paths, rng, first, ahead_m), habits.corner_m)
        route = middle.shifted(self._offset_left(ways, size_m[1], middle))
        if not half_m + spots.junction_m[first] < start_m < route.length_m - half_m - 1:
            return None

        actor = Actor(name, size_m, route, start_m, speed_mps)
        for passage in passages_of(actor):
            if passage.start_m - half_m - STOP_SHORT_M <= start_m < passage.end_m + half_m:
                return None
        return actor

    def _offset_left(self, ways: str, width_m: float, middle: Route) -> Float[np.ndarray, "n"]:
        """Cars keep to the middle of the lane; an actor that is narrow keeps to the right of it.

        On a walk it does so as far as there is room, so that those who meet pass each other.
        """
        low, high = (0.5, 1.0) if width_m < 1.2 else (-0.2, 0.2)
        share = self._rng.uniform(low, high)
        if ways == "walks":
            return -np.maximum(middle.half_width_m + SHOULDER_M - width_m / 2, 0)
        return -share * np.maximum(middle.half_width_m - width_m / 2 - 0.1, 0)


def _crowded(point_m: Points, yaw_rad: Values, size_m: Size, other: Actor) -> Flags:
    """Returns whether an actor there would be too near to where another starts."""
    own, others = (
        (length_m + 2 * START_GAP_M, width_m + 0.3)
        for length_m, width_m, _ in (size_m, other.size_m)
    )
    return boxes_overlap((point_m, yaw_rad, own), (*other.start, others))
