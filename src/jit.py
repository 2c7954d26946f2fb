"""Functions that numba compiles, kept on the disk for the next process.

Numba notices an edit of the file that a compiled function is written in, and none of a file whose
functions it calls. Here all compiled functions of the project share a folder that is named after
what they all say, so an edit of one makes them all anew.
"""

import hashlib
from functools import partial
from pathlib import Path

import numba
from numba.core import config

SOURCE = Path(__file__).parent
# Whatever file holds this line has compiled functions.
MARK = b"jit import njit"


def kernels_digest(source: Path = SOURCE) -> str:
    """Returns twelve hexadecimal digits of the SHA-256 of every file with compiled functions."""
    texts = [path.read_bytes() for path in sorted(source.rglob("*.py"))]
    return hashlib.sha256(b"".join(text for text in texts if MARK in text)).hexdigest()[:12]


_BASE = Path(config.CACHE_DIR or SOURCE / "__pycache__")
# What is compiled remembers the name of the package, which is another one in other projects.
config.CACHE_DIR = str(_BASE / f"kernels-{__package__}-{kernels_digest()}")
njit = partial(numba.njit, cache=True)
