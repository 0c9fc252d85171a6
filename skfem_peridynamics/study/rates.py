"""Rates of convergence, and what an error costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .._types import Floats
from .measure import _FARTHEST, Row


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
    """Return the seconds one scheme needs for an error: log-log between its runs; beyond them, by its last two.

    Returns nan where the runs tell nothing: fewer than two, an error that no longer falls, or one more than eight times
    below the last.
    """
    chosen = sorted(rows, key=lambda row: row.n)
    e, s = np.array([row.error_l2 for row in chosen]), np.array([cost(row) for row in chosen])
    if len(e) < 2:
        return float("nan")
    logs = np.log(e), np.log(s)
    reached = np.flatnonzero(e <= error)
    k = int(reached[0]) if len(reached) else len(e) - 1
    if k == 0:
        return float(s[0])
    fall = logs[0][k - 1] - logs[0][k]
    if fall < 0.3 or error * _FARTHEST < e[k]:
        return float("nan")
    rise = logs[1][k] - logs[1][k - 1]
    if not len(reached):  # beyond the runs an error is never had for less
        rise = max(rise, 0.0)
    return float(np.exp(logs[1][k] + rise * (logs[0][k] - np.log(error)) / fall))
