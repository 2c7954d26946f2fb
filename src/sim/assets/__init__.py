"""The shapes of things, from a passed-in generator: plain solids in their own frame."""

from .actors import ACTORS
from .parts import bounds_m, extent_m, placed, upright

__all__ = ["ACTORS", "bounds_m", "extent_m", "placed", "upright"]
