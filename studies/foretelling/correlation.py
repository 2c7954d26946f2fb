"""Which score foretells collisions: rank correlations over many perceptions, with intervals."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int, Shaped
from torch import Generator, Tensor

from src.errors import UserError
from src.results.bootstrap import interval_of, resamplings, score_samples
from src.results.counts import Counts
from src.results.flights import FLIGHTS, holm, require_same_flights, samples_of
from src.terminal import tracked
from studies.foretelling.windows import WINDOWS, require_scores

# The first row is of all maps and perceptions, the others are resampled; a column a perception.
Samples = Float[np.ndarray, "1+r k"]

# What a good score should foretell; less of each is better.
TARGETS = ("collisions", "stuck", "phantom_stops_per_min")
ALL = "all"
# Counts of a set of frames by map, as they were published in place of the counts of every flight.
MAPS = "maps.npz"
# The difference of two correlations whose power is told, and what 95 % of a normal lies within.
DIFFERENCE, BOUND = 0.2, 1.96


DIFFERENCES = ("difference", "difference_low", "difference_high")

# What tells perceptions of one family apart: the seed of a training, the amount of a damage.
MEMBER = re.compile(r"(-seed|_)[\d.]+$")


@dataclass(frozen=True)
class FlownPerception:
    """One of those that are compared: its name, its ``stratum``, its flights, and where the counts
    of its frames are, as `counts_by_map` reads them, by the name of their set. Those of one
    ``family``, as the seeds of a model, are no independent evidence."""

    name: str
    stratum: str
    flights: pd.DataFrame = field(repr=False)
    frames: Mapping[str, Path]

    @property
    def family(self) -> str:
        return MEMBER.sub("", self.name)

    @property
    def windows(self) -> Path | None:
        """Where the scores of its own flights by second are, as `windows_of` reads them."""
        place = self.frames.get("flown")
        if place is None or place.is_dir():
            return place
        beside = place.with_name(WINDOWS)
        return beside if beside.is_file() else None

    @classmethod
    def all_below(cls, folders: Sequence[Path]) -> list["FlownPerception"]:
        """Returns those of ``<folder>/<stratum>/<name>/<set>/``, whose set ``flown`` has flights,
        by stratum and name.

        Raises `UserError` where there is none, and for a name that is there twice.
        """
        found: dict[str, FlownPerception] = {}
        for path in (path for folder in folders for path in folder.glob(f"*/*/flown/{FLIGHTS}")):
            own = path.parent.parent
            # Where a set has both, those by flight say more.
            places = [*sorted(own.glob(f"*/{MAPS}")), *sorted(own.glob("*/frames"))]
            frames = {each.parent.name: each for each in places}
            flights = pd.read_csv(path, keep_default_na=False)
            if own.name in found:
                raise UserError(f"task.flights: {own.name} is there twice; leave one out")
            found[own.name] = cls(own.name, own.parent.name, flights, frames)
        if not found:
            places = ", ".join(map(str, folders))
            raise UserError(f"{places}: no <stratum>/<name>/flown/{FLIGHTS} there; fly them first")
        return sorted(found.values(), key=lambda each: (each.stratum, each.name))


def compared_with(
    reference: str, perceptions: Sequence[FlownPerception]
) -> tuple[list[FlownPerception], pd.DataFrame]:
    """Returns the perceptions of all strata but the reference's, which has the anchors, and the
    reference's flights. Raises `UserError` without the reference."""
    found = [each for each in perceptions if each.name == reference]
    if not found:
        raise UserError(f"task.reference: no flights of {reference}; fly them, or name another")
    return [each for each in perceptions if each.stratum != found[0].stratum], found[0].flights


def foretelling(
    perceptions: Sequence[FlownPerception],
    reference: str,
    scores: Mapping[str, str],
    against: str,
    resamples: int,
    generator: Generator,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns how well each score orders the perceptions by what comes of their flights, and what
    it orders: a row a perception and set of frames, with its scores and what came of its flights.

    ``scores`` says of each whether its "high" or "low" end is the better. A row of the first table
    has the set of frames, the stratum, the score, the target, Spearman's correlation with its
    interval, Kendall's tau-b, the difference of Spearman's from that of the score ``against`` with
    its interval and ``p``, that by Holm's rule for all scores together, and the power to tell a
    difference of 0.2. A correlation is positive where better scores go with less of the target.
    Collisions are those beyond the perception ``reference``, a flight.

    Over all strata ranks are taken within each, so that no stratum's level makes a correlation.
    Maps and, within the strata, families of perceptions are resampled together; of frames from
    elsewhere, as those of a test split, their own parts are. Raises `UserError` without the
    reference, for a score that there is not, and for perceptions that flew other missions or are
    scored on other frames.
    """
    compared, flown = compared_with(reference, perceptions)
    require_same_flights([(reference, flown), *((each.name, each.flights) for each in compared)])
    maps = sorted(set(flown["map"]))
    weights = resamplings(len(maps), resamples, generator)

    rows, standings = [], []
    for frames in sorted({name for each in compared for name in each.frames}):
        members = [each for each in compared if frames in each.frames]

        places = [each.frames[frames] for each in members]
        counts = [counts_by_map(place) for place in places]
        # Only those that flew themselves saw frames of their own.
        _require_same_frames(places, counts, alike=frames != "flown")
        units = counts[0].clips
        own = weights if units == maps else resamplings(len(units), resamples, generator)
        values = _scores(counts, own)
        require_scores(scores, values, places[0])
        targets = _targets([each.flights for each in members], flown, weights)
        standings.append(_standings(frames, members, targets | {s: values[s] for s in scores}))

        of_member = np.array([each.stratum for each in members])
        for stratum in (*sorted(set(of_member)), ALL):
            kept = np.flatnonzero((of_member == stratum) | (stratum == ALL))
            if len(kept) < 3:
                continue
            families = [members[place].family for place in kept]
            drawn = _drawn(kept, of_member[kept], np.array(families), resamples, generator)
            key = {"frames": frames, "stratum": stratum, "perceptions": len(kept)}
            for target, of_target in targets.items():
                goods = {s: values[s] * (1 if end == "high" else -1) for s, end in scores.items()}
                found = _correlations(goods, -of_target, drawn, against)
                rows += [{**key, "target": target, **row} for row in found]
    table = pd.DataFrame(rows)
    if "p" in table:
        table["p_holm"] = table.groupby(["frames", "stratum", "target"])["p"].transform(holm)
    return table, pd.concat(standings, ignore_index=True) if standings else pd.DataFrame()


def counts_by_map(place: Path) -> Counts:
    """Returns the counts of whole maps, in the order of their names, in place of clips.

    ``place`` is a file of such counts, or a folder with ``<map>/<flight>.npz``.
    """
    if place.is_file():
        return Counts.read(place)
    maps = sorted(folder for folder in place.iterdir() if folder.is_dir())
    by_map = [[Counts.read(path) for path in sorted(folder.glob("*.npz"))] for folder in maps]
    first = by_map[0][0]
    frames = [sum(sum(each.frames) for each in own) for own in by_map]

    def summed(metric: str, name: str) -> Shaped[Tensor, "m *table"]:
        of_maps = ([each.tables[metric][name].sum(0) for each in own] for own in by_map)
        return torch.stack([sum(tables) for tables in of_maps])

    tables = {
        metric: {name: summed(metric, name) for name in of_metric}
        for metric, of_metric in first.tables.items()
    }
    return Counts(first.name, first.protocol, [folder.name for folder in maps], frames, tables)


def _require_same_frames(places: Sequence[Path], counts: Sequence[Counts], alike: bool) -> None:
    """Raises `UserError` for frames of other maps or flights, and for other frames of these where
    they should be ``alike``."""
    flights = [sorted(each.relative_to(place) for each in place.glob("*/*")) for place in places]
    listed = [own for own, place in zip(flights, places) if place.is_dir()]
    for place, own, names in zip(places, counts, flights):
        same = own.clips == counts[0].clips and (place.is_file() or names == listed[0])
        if not same or (alike and own.scored_on_other(counts[0])):
            raise UserError(f"{place}: has other frames than {places[0]}; give task=fly again")


def _scores(counts: Sequence[Counts], weights: Float[Tensor, "r m"]) -> dict[str, Samples]:
    """Returns every score of all counts, whole and by resampled maps."""
    of_counts = []
    for own in tracked(counts, "scoring resampled maps"):
        suite, samples = own.suite(), {}
        for metric, tables in own.tables.items():
            samples |= score_samples(suite.metric(metric), tables, weights)
        of_counts.append(samples)
    names = [name for name in of_counts[0] if all(name in each for each in of_counts)]
    return {s: np.stack([each[s].numpy() for each in of_counts], axis=1) for s in names}


def _targets(
    tables: Sequence[pd.DataFrame], reference: pd.DataFrame, weights: Float[Tensor, "r m"]
) -> dict[str, Samples]:
    """Returns the outcomes of the flights; collisions are in excess of the reference's."""
    weights = torch.cat([torch.ones_like(weights[:1]), weights])
    of_table = [samples_of(each, weights) for each in tables]
    of_target = {t: np.stack([each[t].numpy() for each in of_table], axis=1) for t in TARGETS}
    of_target["collisions"] -= samples_of(reference, weights)["collisions"].numpy()[:, None]
    return of_target


def _standings(
    frames: str, members: Sequence[FlownPerception], values: Mapping[str, Samples]
) -> pd.DataFrame:
    """Returns a row a perception: the values over all maps."""
    own = [{"frames": frames, "stratum": e.stratum, "perception": e.name} for e in members]
    return pd.DataFrame(own).assign(**{name: sample[0] for name, sample in values.items()})


def _drawn(
    places: Int[np.ndarray, "k"],
    strata: Shaped[np.ndarray, "k"],
    families: Shaped[np.ndarray, "k"],
    resamples: int,
    generator: Generator,
) -> dict[str, Int[np.ndarray, "1+r n"]]:
    """Returns for each stratum which perceptions each resample has, as many families as there are;
    first all. Where families are small, -1 stands for none."""
    drawn = {}
    for stratum in sorted(set(strata)):
        of_stratum = strata == stratum
        own = [places[of_stratum & (families == f)] for f in dict.fromkeys(families[of_stratum])]
        padded = np.array(list(zip_longest(*own, fillvalue=-1))).T

        picked = torch.randint(len(own), (resamples, len(own)), generator=generator).numpy()
        picked = np.concatenate([np.arange(len(own))[None], picked])
        drawn[stratum] = padded[picked].reshape(resamples + 1, -1)
    return drawn


def _correlations(
    goods: Mapping[str, Samples],
    good: Samples,
    drawn: Mapping[str, Int[np.ndarray, "1+r n"]],
    against: str,
) -> list[dict[str, object]]:
    """Returns a row a score: how its order of the drawn perceptions is that of what is good."""
    places = np.concatenate(list(drawn.values()), axis=1)
    blocks = np.concatenate([[stratum] * each.shape[1] for stratum, each in drawn.items()])
    take = np.arange(len(places))[:, None], places
    y = np.where(places < 0, np.nan, good[take])
    rhos = {name: torch.from_numpy(spearman(x[take], y, blocks)) for name, x in goods.items()}

    rows = []
    for name, sample in rhos.items():
        row = {"score": name, **dict(zip(("spearman", "low", "high"), interval_of(sample)))}
        row["kendall"] = kendall(goods[name][0, places[0]], y[0], blocks)
        if name != against:
            apart = sample - rhos[against]
            row |= dict(zip(DIFFERENCES, interval_of(apart)))
            row |= {"p": p_value(apart), "power": _power(apart[1:])}
        rows.append(row)
    return rows


def p_value(sample: Float[Tensor, "1+r"]) -> float:
    """Returns the p-value of a difference, whole and resampled: that it is none."""
    drawn = sample[1:][~sample[1:].isnan()]
    fewer = min(int((drawn <= 0).sum()), int((drawn >= 0).sum()))
    # One more, as the whole may be one of them: no p-value is 0.
    return min(2 * (fewer + 1) / (len(drawn) + 1), 1.0)


def _power(differences: Float[Tensor, "r"]) -> float:
    """Returns the chance that a true `DIFFERENCE` is told from none, at 5 %, by their spread."""
    there = differences[~differences.isnan()]
    if len(there) < 2 or not (spread := float(there.std())):
        return math.nan
    return 0.5 * math.erfc((BOUND - DIFFERENCE / spread) / math.sqrt(2))


def spearman(
    first: Samples, second: Samples, blocks: Shaped[np.ndarray, "k"]
) -> Float[np.ndarray, "1+r"]:
    """Returns Spearman's correlation of every row, the ranks taken within the blocks.

    What is NaN is left out; without any difference left it is NaN.
    """
    missing = np.isnan(first) | np.isnan(second)
    x, y = (_ranks(np.where(missing, np.nan, each), blocks) for each in (first, second))
    with np.errstate(invalid="ignore"):
        return (x * y).sum(1) / np.sqrt((x**2).sum(1) * (y**2).sum(1))


def _ranks(values: Samples, blocks: Shaped[np.ndarray, "k"]) -> Samples:
    """Returns ranks within the blocks, their mean taken off, as shares; 0 for what is NaN."""
    ranks = np.zeros_like(values)
    for block in sorted(set(blocks)):
        own = blocks == block
        rank = pd.DataFrame(values[:, own]).rank(axis=1)
        rank = rank.sub(rank.mean(axis=1), axis=0).div(rank.count(axis=1).clip(lower=1), axis=0)
        ranks[:, own] = rank.fillna(0.0).to_numpy()
    return ranks


def kendall(
    first: Float[np.ndarray, "k"],
    second: Float[np.ndarray, "k"],
    blocks: Shaped[np.ndarray, "k"],
) -> float:
    """Returns Kendall's tau-b over the pairs within the blocks; NaN without any difference."""
    kept = ~(np.isnan(first) | np.isnan(second))
    x, y = (np.sign(each[kept][:, None] - each[kept][None]) for each in (first, second))
    same = blocks[kept][:, None] == blocks[kept][None]
    scale = math.sqrt((same * x**2).sum() * (same * y**2).sum())
    return float((same * x * y).sum() / scale) if scale else math.nan
