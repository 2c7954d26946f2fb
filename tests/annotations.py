"""Checks every annotation of the numeric code at every call: types, shapes and dtypes."""

from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook

from tests.sessions import ROOT

SUITES = ("tests", "data", "metrics", "models")
"""Folders of the tests that run with the checks, which take time at every call."""
CHECKED = ("geometry.py", "data/[!_]*.py", "metrics/**/[!_]*.py", "models/[!_]*.py")

# An int may stand where a float is asked for, as for every other checker of types.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


def check_annotations() -> None:
    """Makes modules that are imported from now on check what they are called with, and return.

    Files with compiled functions are left out: numba compiles no function that is wrapped.
    """
    files = [path for pattern in CHECKED for path in (ROOT / "src").glob(pattern)]
    names = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in files
        if "jit import njit" not in path.read_text()
    ]
    install_import_hook(names, "tests.annotations.checked")
