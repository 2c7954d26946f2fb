"""Smooth random fields over a plane that are the same everywhere and for ever: clouds, puddles."""

import numpy as np

from ..jit import njit


@njit
def value_noise(x: float, y: float, octaves: int) -> float:
    """Returns a value in [0, 1], about 0.5 on average.

    Lattice cells of the first octave have side 1. Every octave has twice the frequency and half the
    weight of the one before.
    """
    total = scale = np.float32(0)
    weight = np.float32(1)
    for _ in range(octaves):
        total += weight * _smooth(x, y)
        scale += weight
        weight *= np.float32(0.5)
        # The shift keeps the lattices of octaves from lining up at the origin.
        x, y = x * 2 + np.float32(17.3), y * 2 + np.float32(9.1)
    return total / scale


@njit
def _smooth(x, y):
    """Returns random values at whole numbers, blended without creases between them."""
    column, row = np.floor(x), np.floor(y)
    s, t = x - column, y - row
    s, t = s * s * (3 - 2 * s), t * t * (3 - 2 * t)
    i, j = np.int64(column), np.int64(row)
    # Between the lattice points of two rows, then between the rows.
    near = _at(i, j) + (_at(i + 1, j) - _at(i, j)) * s
    far = _at(i, j + 1) + (_at(i + 1, j + 1) - _at(i, j + 1)) * s
    return near + (far - near) * t


@njit
def _at(i, j):
    """Returns a hash of a lattice point, as a number in [0, 1)."""
    # Numba multiplies in 64 bits; every step is cut back to 32.
    mixed = np.uint32(np.uint32(i) * 0x9E3779B1) ^ np.uint32(np.uint32(j) * 0x85EBCA77)
    mixed = np.uint32((mixed ^ (mixed >> 15)) * 0x2C1B3C6D)
    mixed = np.uint32((mixed ^ (mixed >> 12)) * 0x297A2D39)
    mixed = np.uint32(mixed ^ (mixed >> 15))
    return np.float32(mixed >> 8) * np.float32(1 / 2**24)
