"""How many objects in the way a threshold misses, with a guarantee, and where that ends.

    python -m studies.uncertainty.conformal FOLDER [NAME=FOLDER ...] [--alpha 0.1]
                                            [--unseen TOWN...] [--out FILE]

``FOLDER`` has flights with scores (``task=fly task.scored=true task.looks_on=true``). Conformal
risk control (Angelopoulos et al., 2024) chooses the largest threshold on the probability of
occupied with which the expected share of objects that are missed in the tube is at most ``alpha``.
The unit is the map: flights of one map are not exchangeable with those of others. Rows of the
table: 100 random halves of the maps, calibrated on one and tested on the other; all maps, on which
the threshold is chosen that the other rows test; those of ``--unseen`` towns, which are left out of
the first two; and each other folder, as of another weather or a fault. Where a map is in both, the
change of its coverage is given with an interval of 95 % over maps.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from omegaconf import OmegaConf

from src.errors import UserError
from src.metrics.occupied_calibration import OCCUPIED, VOXELS, edges
from src.metrics.protocol import Protocol, require_same_protocol
from src.results.counts import Counts
from src.results.files import write_table
from src.run_folder import CONFIG
from src.terminal import say, tracked
from studies.settings import run
from studies.tables import print_table

OUT = Path(__file__).with_name("conformal.csv")
SPLITS, RESAMPLES = 100, 2000
# By map: objects of the tube by the level of their warning, and free voxels by theirs.
Maps = Mapping[str, Int[np.ndarray, "2 bins"]]


def controlled(losses: Float[np.ndarray, "n thresholds"], alpha: float) -> int:
    """Returns the last of ascending thresholds at which the expected loss is at most ``alpha``.

    ``losses`` in [0, 1] ascend with the threshold. A new map that is exchangeable with the n ones
    loses at most ``alpha`` in expectation: ``n / (n + 1) * mean + 1 / (n + 1) <= alpha``. Raises
    `UserError` for an ``alpha`` outside (0, 1), fewer maps than it needs, and losses that are none.
    """
    if not 0 < alpha < 1:
        raise UserError(f"--alpha: {alpha}; give a share between 0 and 1, as 0.1")
    if not ((losses >= 0) & (losses <= 1)).all():
        raise UserError("the losses hold NaN, or what is no share; look at the beliefs")
    n = len(losses)
    needed = int(np.ceil(1 / alpha - 1 - 1e-9))
    if n < needed:
        raise UserError(
            f"--alpha: {alpha} needs {needed} maps or more, and here are {n}; fly on more, or give "
            "a larger one"
        )
    bound = losses.sum(axis=0) / (n + 1) + 1 / (n + 1)
    return int((bound <= alpha).sum()) - 1


def losses_of(maps: Maps) -> Float[np.ndarray, "n bins"]:
    """Returns the share of objects below each level, by map; 0 where there is no object."""
    objects = np.stack([each[0] for each in maps.values()]).astype(float)
    below = objects.cumsum(axis=1) - objects
    return below / np.maximum(objects.sum(axis=1, keepdims=True), 1)


def free_of(maps: Maps) -> Float[np.ndarray, "bins"]:
    """Returns the share of free voxels of the tube that a threshold leaves free."""
    free = sum(each[1] for each in maps.values()).astype(float)
    return (free.cumsum() - free) / max(free.sum(), 1)


def read_maps(folder: Path) -> tuple[Maps, dict[str, Protocol]]:
    """Reads the counts of all scored flights, and the protocol of each. Raises `UserError` where
    there are none, or the perception itself flew."""
    maps: dict[str, np.ndarray] = {}
    protocols: dict[str, Protocol] = {}
    config = folder / CONFIG
    if not config.is_file() or not OmegaConf.select(OmegaConf.load(config), "task.looks_on"):
        raise UserError(f"{folder}: not flown with task.looks_on=true, as {CONFIG} would say")
    paths = sorted(folder.glob("frames/*/*.npz"))
    for path in tracked(paths, f"reading {folder}"):
        counts = Counts.read(path)
        # A flight has as many frames as it lasts.
        tables, protocols[str(path)] = counts.tables, replace(counts.protocol, frames=0)
        if "occupied" not in tables:
            raise UserError(f"{path}: no probabilities were scored; fly with today's conf/suite")
        objects = tables["occupied"]["objects"].sum(0).numpy()
        tube = tables["occupied"]["tube"].sum(0).numpy()
        found = np.stack([objects, tube[:, VOXELS] - tube[:, OCCUPIED]])
        maps[path.parent.name] = maps.get(path.parent.name, 0) + found
    if not maps:
        raise UserError(f"{folder}: no frames/<map>/<flight>.npz; fly with task.scored=true")
    return maps, protocols


def row_of(name: str, maps: Maps, level: int, calibrated_on: int) -> dict[str, object]:
    losses = losses_of(maps)[:, level]
    return {
        **{"maps": name, "n": calibrated_on, "tested": len(maps)},
        "objects": int(sum(each[0].sum() for each in maps.values())),
        "threshold": float(np.r_[0.0, edges()][level]),
        "coverage": 1 - losses.mean(),
        "free": free_of(maps)[level],
    }


def change_of(maps: Maps, own: Maps, level: int) -> dict[str, float]:
    """Returns by how much the coverage of the maps of both changes, with an interval; nothing where
    there are none."""
    names = [name for name in maps if name in own]
    if not names:
        return {}
    was, now = (losses_of({name: each[name] for name in names})[:, level] for each in (own, maps))
    drawn = np.random.default_rng(0).integers(len(names), size=(RESAMPLES, len(names)))
    bounds = np.quantile((was - now)[drawn].mean(axis=1), (0.025, 0.975))
    # A single map has no interval.
    low, high = bounds if len(names) > 1 else (np.nan, np.nan)
    return {"change": (was - now).mean(), "change_low": low, "change_high": high}


def halves(maps: Maps, alpha: float) -> dict[str, object]:
    """Returns the means of the rows of random halves of the maps."""
    rng, names, rows = np.random.default_rng(0), list(maps), []
    for _ in range(SPLITS):
        first, second = np.array_split(rng.permutation(names), 2)
        chosen, others = ({name: maps[name] for name in half} for half in (first, second))
        level = controlled(losses_of(chosen), alpha)
        rows.append(row_of("", others, level, len(chosen)))
    means = pd.DataFrame(rows).drop(columns="maps").mean().to_dict()
    return {"maps": f"{SPLITS} halves", **means}


def main(*folders: str, alpha: float = 0.1, unseen: tuple[str, ...] = (), out: Path = OUT) -> None:
    if not folders:
        raise UserError("give a folder of flights; see the head of this file")
    (own, protocols), others = read_maps(Path(folders[0])), {}
    for word in folders[1:]:
        name, is_named, folder = word.partition("=")
        if not is_named:
            raise UserError(f"{word}: give NAME=FOLDER")
        others[name], own_protocols = read_maps(Path(folder))
        protocols |= own_protocols
    require_same_protocol(protocols)

    town_of = {name: name.rpartition("-")[0] for name in own}
    if unknown := {*unseen}.difference(town_of.values()):
        towns = ", ".join(sorted({*town_of.values()}))
        raise UserError(f"--unseen: there is no {sorted(unknown)[0]}; there are {towns}")
    apart = {name: each for name, each in own.items() if town_of[name] in unseen}
    seen = {name: each for name, each in own.items() if name not in apart}
    level = controlled(losses_of(seen), alpha)
    rows = [halves(seen, alpha), row_of("all", seen, level, len(seen))]
    tested = {"unseen towns": apart, **others}
    rows += [
        row_of(name, each, level, len(seen)) | change_of(each, seen, level)
        for name, each in tested.items()
        if each
    ]
    table = pd.DataFrame(rows)
    write_table(table.round(4), out)

    columns = ("maps", "calibrated on", "tested on", "objects", "threshold", "coverage", "change")
    columns += ("free",)
    shown = [
        [
            row["maps"],
            *(f"{row[key]:.0f}" for key in ("n", "tested", "objects")),
            f"{row['threshold']:.3f}",
            f"{row['coverage']:.1%}",
            _told(row),
            f"{row['free']:.1%}",
        ]
        for row in rows
    ]
    title = f"Objects in the tube with a warning, at least {1 - alpha:.0%} wanted"
    print_table(title, columns, shown)
    say(out)


def _told(row: Mapping[str, object]) -> str:
    if "change" not in row:
        return ""
    return "{change:+.1%} ({change_low:+.1%} to {change_high:+.1%})".format(**row)


if __name__ == "__main__":
    run(main)
