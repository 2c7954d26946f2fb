"""Static places as plain data. Another town is another module here with ``build(rng) -> Town``."""

from collections.abc import Callable

import numpy as np

from ...errors import UserError
from ..layout import Town
from . import campus, downtown, industrial, market, old_town, park, suburb, waterfront

TOWNS: dict[str, Callable[[np.random.Generator], Town]] = {
    "downtown": downtown.build,
    "suburb": suburb.build,
    "old_town": old_town.build,
    "park": park.build,
    "industrial": industrial.build,
    "campus": campus.build,
    "waterfront": waterfront.build,
    "market": market.build,
}


def build_town(name: str, rng: np.random.Generator) -> Town:
    """The town of that name; the generator decides its details. Raises `UserError`."""
    if name not in TOWNS:
        raise UserError(f"sim.towns: there is no town {name!r}; choose from {', '.join(TOWNS)}")
    return TOWNS[name](rng)
