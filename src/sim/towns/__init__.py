"""Static places as plain data. A town is one module with a function ``build(rng) -> Town``.

No list names the towns: a module of this folder that has such a function is a town, and a dotted
path (``mypackage.mytown``) names a module of the user's own.
"""

import pkgutil
from collections.abc import Callable
from importlib import import_module

from ...errors import UserError, closest
from ..layout import Town
from ..solid import Rng

Build = Callable[[Rng], Town]


def build_town(name: str, rng: Rng) -> Town:
    """Builds the town of that name; the generator decides its details. Raises `UserError`."""
    return builder_of(name)(rng)


def builder_of(name: str) -> Build:
    """Returns the function that builds the town of that name. Raises `UserError`."""
    # YAML may hold a number where a name was meant.
    name = str(name)
    build = _build_in(name if "." in name else f"{__name__}.{name}")

    if build is None:
        known = town_names()
        raise UserError(
            f"sim.towns: there is no town {name!r}{closest(name, known)} there are "
            f"{', '.join(known)}, and modules of your own with a function build(rng), by their "
            "dotted path"
        )
    return build


def town_names() -> list[str]:
    """Returns the names of all towns of this folder, in alphabetical order.

    The folder also holds what the towns share (streets, sites), which builds none.
    """
    modules = pkgutil.iter_modules(__path__)
    return [module.name for module in modules if _build_in(f"{__name__}.{module.name}")]


def _build_in(path: str) -> Build | None:
    """Returns the function ``build`` of a module; None where either is missing."""
    if not all(part.isidentifier() for part in path.split(".")):
        return None
    try:
        module = import_module(path)
    except ModuleNotFoundError as error:
        # A town whose own imports fail is there: that mistake is shown as it is.
        if error.name is None or not f"{path}.".startswith(f"{error.name}."):
            raise
        return None
    build = getattr(module, "build", None)
    return build if callable(build) else None
