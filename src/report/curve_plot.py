"""Learning curves of several runs in one plot, as SVG that a page embeds."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

Point = tuple[float, float]

WIDTH, HEIGHT = 480, 290
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 14, 44
"""Room around the curves, for the numbers of the axes."""
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
COLORS, DASHES = 8, 3
"""How many colours and kinds of line the page's style sheet has; the kind changes when all colours
have been used."""


@dataclass(frozen=True)
class Curve:
    """One training: a quantity over the epochs, counted from 1. Curves of one ``name`` are the
    seeds of one run. Values that are not finite are left out."""

    name: str
    epochs: tuple[float, ...]
    values: tuple[float, ...]

    def points(self) -> list[Point]:
        """Epoch and value, in the order of the epochs."""
        pairs = zip(self.epochs, self.values)
        return sorted((e, v) for e, v in pairs if math.isfinite(e) and math.isfinite(v))


@dataclass(frozen=True)
class CurvePlot:
    """Curves of one quantity; ``unit`` stands behind its values, and may be empty."""

    title: str
    unit: str
    curves: tuple[Curve, ...]

    def runs(self) -> dict[str, list[list[Point]]]:
        """The points of each seed of each run that has any, in the order of the curves."""
        found: dict[str, list[list[Point]]] = {}
        for curve in self.curves:
            if points := curve.points():
                found.setdefault(curve.name, []).append(points)
        return found


def mean_of(seeds: Sequence[Sequence[Point]]) -> list[Point]:
    """The mean over the seeds, at the epochs that all of them have.

    Elsewhere it would jump where a seed ends and nothing was learned.
    """
    values = [dict(seed) for seed in seeds]
    shared = sorted(set.intersection(*(set(each) for each in values)))
    return [(epoch, math.fsum(each[epoch] for each in values) / len(values)) for epoch in shared]


def ticks_of(low: float, high: float, count: int, whole: bool = False) -> list[float]:
    """About ``count`` round numbers; the first is no higher than ``low``, the last no lower than
    ``high``."""
    if high <= low:
        low, high = low - 0.5, high + 0.5
    power = 10.0 ** math.floor(math.log10((high - low) / count))
    step = next(s * power for s in STEPS if (high - low) / (s * power) <= count)
    if whole:
        step = max(1.0, math.ceil(step))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [n * step for n in range(first, last + 1)]


def plot_html(plot: CurvePlot) -> str:
    """A ``figure`` with the curves, and below them the value of each run at the last epoch; the
    page's script puts the epoch there that a reader points at.

    The seeds of a run are thin lines, their mean is a thick one.
    """
    runs = plot.runs()
    head = f"<figcaption><h3>{escape(plot.title)}</h3></figcaption>"
    if not runs:
        return f'<figure class="plot">{head}<p class="none">Nothing was logged.</p></figure>'
    axes = _Axes.around(runs)
    lines = "".join(_run_svg(n, seeds, axes) for n, seeds in enumerate(runs.values()))
    stops = _stops(plot.unit, runs, axes)
    last = stops[-1]
    described = escape(f"{plot.title}: curves of {', '.join(runs)}")
    return (
        f'<figure class="plot" data-stops="{escape(json.dumps(stops))}">{head}'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" tabindex="0" aria-label="{described}">'
        f'{axes.svg(plot.unit)}{lines}<line class="cursor" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
        f'</svg><p class="stop" aria-live="polite">epoch <b>{last["epoch"]}</b></p>'
        '<ul class="runs">'
        + "".join(map(_legend_html, range(len(runs)), runs, last["texts"]))
        + "</ul></figure>"
    )


@dataclass(frozen=True)
class _Axes:
    """The round numbers along both axes, whose ends are the ends of the plot."""

    epochs: list[float]
    values: list[float]

    @classmethod
    def around(cls, runs: dict[str, list[list[Point]]]) -> "_Axes":
        points = [point for seeds in runs.values() for seed in seeds for point in seed]
        epochs, values = zip(*points)
        first = min(0.0, *epochs)
        return cls(
            ticks_of(first, max(epochs), 8, whole=True), ticks_of(min(values), max(values), 5)
        )

    def place(self, epoch: float, value: float) -> Point:
        """Where a point is drawn."""
        return self.across(epoch), self.up(value)

    def across(self, epoch: float) -> float:
        first, last = self.epochs[0], self.epochs[-1]
        return round(LEFT + (epoch - first) / (last - first) * (WIDTH - LEFT - RIGHT), 2)

    def up(self, value: float) -> float:
        low, high = self.values[0], self.values[-1]
        return round(HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM), 2)

    def svg(self, unit: str) -> str:
        floor = HEIGHT - BOTTOM
        rows = [
            f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{self.up(value)}" y2="{self.up(value)}"/>'
            f'<text class="value" x="{LEFT - 8}" y="{self.up(value)}">{value:g}'
            f"{' ' + escape(unit) if unit and value == self.values[-1] else ''}</text>"
            for value in self.values
        ]
        columns = [
            f'<text class="epoch" x="{self.across(epoch)}" y="{floor + 20}">{epoch:g}</text>'
            for epoch in self.epochs
        ]
        middle = (LEFT + WIDTH - RIGHT) / 2
        name = f'<text class="epoch" x="{middle}" y="{HEIGHT - 6}">epoch</text>'
        return f'<g class="axes">{"".join(rows + columns)}{name}</g>'


def _run_svg(n: int, seeds: list[list[Point]], axes: _Axes) -> str:
    thin = [_line("seed", seed, axes) for seed in seeds] if len(seeds) > 1 else []
    mean = mean_of(seeds)
    dots = "".join(
        '<circle cx="{}" cy="{}" r="2.6"/>'.format(*axes.place(*point)) for point in mean
    )
    return f'<g class="run {_style(n)}">{"".join(thin)}{_line("mean", mean, axes)}{dots}</g>'


def _legend_html(n: int, name: str, text: str) -> str:
    return (
        f'<li class="{_style(n)}"><svg class="swatch" viewBox="0 0 30 4" aria-hidden="true">'
        '<line x1="1" x2="29" y1="2" y2="2"/></svg>'
        f"<span>{escape(name)}</span><b>{escape(text)}</b></li>"
    )


def _style(n: int) -> str:
    """The classes of the n-th run's curves."""
    return f"color-{n % COLORS} dash-{n // COLORS % DASHES}"


def _line(kind: str, points: Sequence[Point], axes: _Axes) -> str:
    places = " ".join("{},{}".format(*axes.place(*point)) for point in points)
    return f'<polyline class="{kind}" points="{places}"/>' if points else ""


def _stops(unit: str, runs: dict[str, list[list[Point]]], axes: _Axes) -> list[dict]:
    """Each epoch, with its place and a text for each run."""
    epochs = sorted({epoch for seeds in runs.values() for seed in seeds for epoch, _ in seed})
    return [
        {
            "epoch": f"{epoch:g}",
            "x": axes.across(epoch),
            "texts": [_spoken(unit, seeds, epoch) for seeds in runs.values()],
        }
        for epoch in epochs
    ]


def _spoken(unit: str, seeds: list[list[Point]], epoch: float) -> str:
    """The value at an epoch; of several seeds the mean, and the lowest and the highest."""
    values = [dict(seed)[epoch] for seed in seeds if epoch in dict(seed)]
    if not values:
        return "–"
    text = f"{_number(math.fsum(values) / len(values), unit)}{unit and ' ' + unit}"
    if len(seeds) == 1:
        return text
    low, high = (_number(end(values), unit) for end in (min, max))
    return f"{text} ({low} to {high}, {len(values)} seed{'s' * (len(values) > 1)})"


def _number(value: float, unit: str) -> str:
    """One decimal of a percentage, three digits of anything else."""
    return f"{value:.1f}" if unit == "%" else f"{value:#.3g}".rstrip(".")
