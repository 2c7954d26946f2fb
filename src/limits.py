"""Checks of single settings; each names the key, its value and what to give instead."""

import math
from collections.abc import Collection, Mapping
from numbers import Real

from .errors import UserError


def require_at_least(least: float, group: str, settings: Mapping, *names: str) -> None:
    """Raises `UserError` for a setting of a group of the configuration that is below ``least``, or
    not finite.

    A setting that is null, not there, or no number, as a class of one's own may take, passes.
    """
    for name in names:
        value = settings.get(name)
        if not isinstance(value, Real):
            continue
        if not math.isfinite(value):
            raise UserError(f"{group}.{name}: {value} is not finite; give {least} or more")
        if value < least:
            raise UserError(f"{group}.{name}: {value} is too small; give {least} or more")


def require_finite(name: str, value: float, zero: bool = False) -> None:
    """Raises `UserError` for an argument that is not a finite number above 0, or ``zero`` itself
    where that may be."""
    if not (math.isfinite(value) and (value > 0 or (zero and value == 0))):
        least = ", 0 or more" if zero else " above 0"
        raise UserError(f"{name}: {value} must be a finite number{least}")


def require_count(key: str, value: object) -> None:
    """Raises `UserError` for what is neither null nor an integer of 1 or more."""
    if value is not None and (type(value) is not int or value < 1):
        raise UserError(f"{key}: {value!r}; give an integer of 1 or more, or null")


def require_choice(key: str, value: object, choices: Collection[str]) -> None:
    """Raises `UserError` for a value that is not one of the choices."""
    if value not in choices:
        raise UserError(f"{key}: {value!r}; there are {', '.join(choices)}")
