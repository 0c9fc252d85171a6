"""Integrals of the influence function up to a distance, from a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .._types import Floats

_TABLE = 4096


class Cumulative:
    """``int_0^a J(s) s^power ds`` for many a.

    >>> round(float(Cumulative(np.ones_like, 1)(np.array([0.5]))[0]), 9)
    0.125
    """

    def __init__(self, influence: Callable[[Floats], Floats], power: int) -> None:
        x, w = np.polynomial.legendre.leggauss(8)
        self.grid = np.linspace(0.0, 1.0, _TABLE + 1)
        s = self.grid[:-1, None] + 0.5 * (x + 1.0) / _TABLE
        pieces = (influence(s) * s**power) @ (0.5 * w / _TABLE)
        self.table = np.concatenate([[0.0], np.cumsum(pieces)])

    def __call__(self, a: Floats) -> Floats:
        value: Floats = np.interp(a, self.grid, self.table)
        return value
