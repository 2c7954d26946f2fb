"""The right of way over junctions: first come, first served, under traffic lights where there are
any.

An actor asks when it comes near and holds its whole way over the junction from when that is granted
until it has left. So actors whose ways meet never are on them at the same time, and no two of them
wait for each other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from .actor import Actor
from .layout import Gate, Path
from .lights import LightPlan

# Fronts stop this far before the line.
STOP_SHORT_M = 0.5
REACTION_S = 1.0
# The least distance between the areas that two ways sweep, for both to be used at the same time.
ROOM_M = 0.3
SWEEP_M = 0.5


@dataclass(frozen=True)
class Passage:
    """A way over a junction: the arcs of the route between which an actor is on it.

    ``approach`` is the path that leads to the gate, ``swept_m`` are places that the actor covers.
    """

    gate: Gate
    approach: Path
    start_m: float
    end_m: float
    swept_m: Float[np.ndarray, "k 2"]


def passages_of(actor: Actor) -> list[Passage]:
    """Returns all junctions on an actor's route, in the order in which it comes to them."""
    route, half_m = actor.route, actor.size_m[0] / 2
    ends_m = np.cumsum([path.length_m for path in route.paths])
    passages = []
    for k, path in enumerate(route.paths):
        gate = path.gate
        if gate is None:
            continue
        # People cross within one path; a car crosses on the turn, which is the next path.
        over = min(k if gate.is_crossing else k + 1, len(ends_m) - 1)
        along_m = np.array([ends_m[k] - path.length_m + gate.at_m, ends_m[over] + gate.clear_m])
        start_m, end_m = route.arc_of(along_m)

        # The ends of a long vehicle swing wide of the way that its middle takes.
        middle_m, heading_rad = route.at(np.arange(start_m - half_m, end_m + half_m, SWEEP_M))
        ahead_m = half_m * np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=1)
        swept_m = np.concatenate([middle_m - ahead_m, middle_m, middle_m + ahead_m])
        passages.append(Passage(gate, path, float(start_m), float(end_m), swept_m))
    return passages


class RightOfWay:
    """Decides, at one time after another, which actors must stop and where.

    Its arrays have one entry for each actor, or one for each claim: an actor's passage.
    """

    def __init__(self, actors: Sequence[Actor], plans: Mapping[int, LightPlan]) -> None:
        claims = [(k, passage) for k, actor in enumerate(actors) for passage in passages_of(actor)]
        self._plans = plans
        self._passages = [passage for _, passage in claims]
        self._owner = np.array([owner for owner, _ in claims], dtype=int)
        self._start_m = np.array([passage.start_m for passage in self._passages])
        self._end_m = np.array([passage.end_m for passage in self._passages])

        self._half_m = np.array([actor.size_m[0] / 2 for actor in actors])
        self._brake_mps2 = np.array([actor.habits.brake_mps2 for actor in actors])
        self._wanted_mps = np.array([actor.speed_mps for actor in actors])

        # Claims on one approach wait for each other; people pass each other on a walk, so each of
        # them has an approach of its own.
        approaches = [
            -1 - k if passage.gate.is_crossing else id(passage.approach)
            for k, passage in enumerate(self._passages)
        ]
        self._approach = np.array(approaches, dtype=int)
        self._meet = _meeting(actors, self._owner, self._passages)
        self._granted = np.zeros(len(claims), dtype=bool)
        self._asked_s = np.full(len(claims), np.inf)

    def stops_m(
        self, time_s: float, arc_m: Float[np.ndarray, "n"], speed_mps: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Returns the arc beyond which each actor's middle must not go; inf where it may go on."""
        stop_m = self._start_m - STOP_SHORT_M - self._half_m[self._owner]
        ahead_m = stop_m - arc_m[self._owner]
        braking_m = (speed_mps**2 / (2 * self._brake_mps2))[self._owner]
        gone = (arc_m - self._half_m)[self._owner] > self._end_m
        near = ~gone & (ahead_m < braking_m + REACTION_S * speed_mps[self._owner] + ROOM_M)

        # A grant lasts until the actor has left, unless the lights turn while it can still stop.
        open_now = np.zeros(len(gone), dtype=bool)
        open_now[near] = [self._is_open(k, time_s) for k in np.flatnonzero(near)]
        if time_s == 0:
            self._granted |= near & (ahead_m < 0)
        # An actor that could not stop any more goes on, as at the beginning of amber.
        self._granted &= ~gone & (open_now | (ahead_m < braking_m))

        waiting = ~gone & ~self._granted
        asks = near & open_now & waiting & self._is_first(waiting, ahead_m)
        self._asked_s = np.where(asks, np.minimum(self._asked_s, time_s), np.inf)
        self._grant()

        stops_m = np.full(len(arc_m), np.inf)
        waiting &= ~self._granted
        np.minimum.at(stops_m, self._owner[waiting], stop_m[waiting])
        return stops_m

    def _is_open(self, claim: int, time_s: float) -> bool:
        """Returns whether the lights allow a claim.

        People may go only if they will be over before traffic comes.
        """
        passage = self._passages[claim]
        gate = passage.gate
        if gate.phase is None:
            return True
        plan = self._plans[gate.junction]
        if not gate.is_crossing:
            return plan.is_green(gate.phase, time_s)

        needed_s = (passage.end_m - passage.start_m) / self._wanted_mps[self._owner[claim]]
        return plan.red_for_s(gate.phase, time_s) >= needed_s

    def _is_first(
        self, waiting: Bool[np.ndarray, "c"], ahead_m: Float[np.ndarray, "c"]
    ) -> Bool[np.ndarray, "c"]:
        """Returns which claims are the first on their approach: others could not go before."""
        nearest_first = np.argsort(np.where(waiting, ahead_m, np.inf), kind="stable")
        _, index = np.unique(self._approach[nearest_first], return_index=True)
        first = np.zeros(len(waiting), dtype=bool)
        first[nearest_first[index]] = True
        return first

    def _grant(self) -> None:
        """Grants claims that meet none that is granted, and none that was asked for earlier."""
        busy = self._granted.copy()
        asked = np.flatnonzero(np.isfinite(self._asked_s))
        for claim in asked[np.argsort(self._asked_s[asked], kind="stable")]:
            self._granted[claim] = not (self._meet[claim] & busy).any()
            busy[claim] = True


def _meeting(
    actors: Sequence[Actor], owner: Int[np.ndarray, "c"], passages: Sequence[Passage]
) -> Bool[np.ndarray, "c c"]:
    """Returns which passages must not be held together."""
    meet = np.zeros((len(passages), len(passages)), dtype=bool)
    for a, one in enumerate(passages):
        for b, other in enumerate(passages[:a]):
            # People share a crossing, and actors on one path follow each other.
            apart = one.gate.junction != other.gate.junction or owner[a] == owner[b]
            shared = one.gate.is_crossing and other.gate.is_crossing
            if apart or shared or one.approach is other.approach:
                continue

            widths_m = actors[owner[a]].size_m[1] + actors[owner[b]].size_m[1]
            offset_m = one.swept_m[:, None] - other.swept_m[None]
            least_m = np.hypot(offset_m[..., 0], offset_m[..., 1]).min()
            meet[a, b] = meet[b, a] = least_m < widths_m / 2 + ROOM_M
    return meet
