"""Rates of convergence, and what an error costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .._types import Floats
from .measure import Row


def rate(size: Sequence[float], error: Sequence[float]) -> Floats:
    """Return the observed orders between neighbours.

    >>> rate([0.2, 0.1], [4e-2, 1e-2]).tolist()
    [2.0]
    """
    h, e = np.asarray(size), np.asarray(error)
    return np.asarray(np.diff(np.log(e)) / np.diff(np.log(h)))


def pareto(seconds: Sequence[float], error: Sequence[float]) -> list[int]:
    """Return the points that no other beats in both, by seconds.

    >>> pareto([1.0, 2.0, 3.0], [0.1, 0.2, 0.05])
    [0, 2]
    """
    best, out = np.inf, []
    for k in np.lexsort((error, seconds)):
        if error[k] < best:
            best = error[k]
            out.append(int(k))
    return out


def seconds_to(rows: Sequence[Row], error: float, cost: Callable[[Row], float] = lambda row: row.seconds) -> float:
    """Return the seconds one scheme needs for an error: log-log between its runs; nan where none reached it."""
    chosen = sorted(rows, key=lambda row: row.n)
    e, s = np.array([row.error_l2 for row in chosen]), np.array([cost(row) for row in chosen])
    reached = np.flatnonzero(e <= error)
    if not len(reached):
        return float("nan")
    k = int(reached[0])
    if k == 0:
        return float(s[0])
    part = np.log(e[k - 1] / error) / np.log(e[k - 1] / e[k])
    return float(s[k - 1] * (s[k] / s[k - 1]) ** part)
