"""Compiled loops over pairs for a body with a dilatation: the virial first, then forces under its pressure.

They gather as :mod:`~skfem_peridynamics.engine.pair_loops` does. V has the virial of the samples, p their pressure.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled, unordered
from .law_loops import (
    BATCH,
    EXPONENTIAL,
    R2,
    RATIONAL,
    REST,
    ROOM,
    TENSION,
    C,
    K,
    Q,
    S,
    _only_stretched,
    bend,
    exponential,
    inverse_root,
    snap,
)
from .pair_loops import _gather, _scatter, cell_share

# one row more than other loops have
PRESSURE = ROOM
_ROOM = ROOM + ROOM // 9


@unordered
def _sum(W: Any, n: int) -> float:
    total = 0.0
    for m in range(n):
        total += W[m + K]
    return total


@compiled
def _add(J: Any, n: int, W: Any, V: Any) -> None:
    for m in range(n):
        V[np.uint32(J[m])] += W[m + K]


@compiled
def _gather_lengths(axes: Any, J: Any, n: int, i: int, P: Any, given: Any, W: Any) -> None:
    """What :func:`~.pair_loops._gather` does, but for the bond vectors."""
    dim = len(axes)
    x0, y0, z0 = P[i, 0], P[i, dim // 2], P[i, dim - 1]
    u0, v0, w0 = P[i, dim + 1], P[i, dim + 1 + dim // 2], P[i, 2 * dim]
    for m in range(n):
        j = np.uint32(J[m])
        d = P[j, 0] - x0
        along = d * (P[j, dim + 1] - u0)
        length = d * d
        if dim > 1:
            d = P[j, 1] - y0
            along += d * (P[j, dim + 2] - v0)
            length += d * d
        if dim > 2:
            d = P[j, 2] - z0
            along += d * (P[j, dim + 3] - w0)
            length += d * d
        W[m + S] = along
        W[m + R2] = length
        if given is None:
            W[m + K] = P[j, dim]
            W[m + REST] = P[j, 2 * dim + 1]


@compiled
def _measure(n: int, given: Any, low: int, reach: float, scale: float, own: float, own_size: float, W: Any) -> None:
    """``c = s / r`` and ``q = s^2 / r^3``, and the measures, as :func:`~.pair_loops._pull_cells` makes them."""
    least = 0.0 if reach > 0.0 else 1.0
    for m in range(n):
        root = inverse_root(W[m + R2])
        c = W[m + S] * root
        W[m + C] = c
        W[m + Q] = c * c * root
        if given is None:
            W[m + K] *= scale * own * cell_share(reach - W[m + R2] * root, W[m + REST], own_size, least)
        else:
            W[m + K] = scale * given[low + m]


@compiled
def _pressed(
    n: int, given: Any, low: int, reach: float, scale: float, own: float, own_size: float, p: float, W: Any
) -> None:
    """``c = s / r^3``, ``q = s c`` and the measures; ``(p_x + p_y) / r`` in REST, of the p_y in PRESSURE."""
    least = 0.0 if reach > 0.0 else 1.0
    for m in range(n):
        root = inverse_root(W[m + R2])
        s = W[m + S]
        c = s * (root * root * root)
        W[m + C] = c
        W[m + Q] = s * c
        if given is None:
            W[m + K] *= scale * own * cell_share(reach - W[m + R2] * root, W[m + REST], own_size, least)
        else:
            W[m + K] = scale * given[low + m]
        W[m + REST] = (p + W[m + PRESSURE]) * root


@compiled
def _take_pressure(J: Any, n: int, p: Any, W: Any) -> None:
    for m in range(n):
        W[m + PRESSURE] = p[np.uint32(J[m])]


@compiled
def _bend_pressed(kind: int, slope: float, b: float, df: Any, d2f: Any, W: Any, n: int) -> None:
    """Turn K into ``K (2 C f'(Q) + REST (f'(Q) + 2 Q f''(Q)))``."""
    if kind >= TENSION:
        _only_stretched(W, n)
        kind -= TENSION
    if df is not None:
        for m in range(n):
            q = min(W[m + Q], 1e300)
            first = df(q)
            W[m + K] *= 2.0 * W[m + C] * first + W[m + REST] * (first + 2.0 * q * d2f(q))
    elif kind == EXPONENTIAL:
        for m in range(n):
            x = -b * W[m + Q]
            bent = slope * exponential(x)
            # beyond -708, where the exponential ends, nothing is left
            W[m + K] *= bent * (2.0 * W[m + C] + W[m + REST] * (1.0 + 2.0 * max(x, -708.0)))
    elif kind == RATIONAL:
        for m in range(n):
            z = b * W[m + Q]
            t = 1.0 / (1.0 + z)
            # f' + 2 q f'' = f' (1 - 4 z / (1 + z)), and z / (1 + z) is 1 - t
            W[m + K] *= slope * t * t * (2.0 * W[m + C] + W[m + REST] * (4.0 * t - 3.0))
    else:
        for m in range(n):
            W[m + K] *= slope * (2.0 * W[m + C] + W[m + REST])


@compiled
def virial(
    axes: Any,
    start: Any,
    far: Any,
    first: int,
    P: Any,
    given: Any,
    reach: float,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    own: Any,
    V: Any,
    limit: Any = None,
    both: bool = True,
) -> int:
    """Add ``k sqrt(r) F1'(T) / 2`` of the bonds to V, at both ends.

    Bonds beyond a ``limit`` break; return how many, see :func:`~.law_loops.snap`.
    """
    W, dim = np.empty(ROOM), len(axes)
    count = 0
    for row in range(len(start) - 1):
        i = first + row
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _gather_lengths(axes, J, n, i, P, given, W)
            _measure(n, given, low, reach, 0.5 * scale, P[i, dim], P[i, 2 * dim + 1], W)
            # numba drops this branch where the loop is compiled without a limit
            if limit is not None:
                count += snap(limit, both, W, given, low, n)
            bend(kind, slope, b, own, W, n)
            V[i] += _sum(W, n)
            _add(J, n, W, V)
    return count


@compiled
def force(
    axes: Any,
    start: Any,
    far: Any,
    first: int,
    P: Any,
    given: Any,
    reach: float,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    df: Any,
    d2f: Any,
    p: Any,
    F: Any,
) -> None:
    """Add the forces of the bonds under a pressure to F, three rows as in :func:`~.pair_loops.force`."""
    W, dim = np.empty(_ROOM), len(axes)
    for row in range(len(start) - 1):
        i = first + row
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _gather(axes, J, n, i, P, given, W)
            _take_pressure(J, n, p, W)
            _pressed(n, given, low, reach, scale, P[i, dim], P[i, 2 * dim + 1], p[i], W)
            _bend_pressed(kind, slope, b, df, d2f, W, n)
            _scatter(axes, J, n, i, W, F)


@compiled
def dilate(axes: Any, start: Any, far: Any, first: int, P: Any, rates: Any, V: Any) -> None:
    """Add ``rate T`` of the bonds to V, at both ends."""
    W = np.empty(ROOM)
    for row in range(len(start) - 1):
        i = first + row
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _gather(axes, J, n, i, P, rates, W)
            total = 0.0
            for m in range(n):
                root = inverse_root(W[m + R2])
                W[m + K] = rates[low + m] * W[m + S] * (root * np.sqrt(root))
                total += W[m + K]
            V[i] += total
            _add(J, n, W, V)


@compiled
def squeeze(axes: Any, start: Any, far: Any, first: int, P: Any, rates: Any, p: Any, F: Any) -> None:
    """Add ``rate (p_x + p_y) xi / r^(3/2)`` to F: minus the transpose of :func:`dilate`."""
    W = np.empty(ROOM)
    for row in range(len(start) - 1):
        i = first + row
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _gather(axes, J, n, i, P, rates, W)
            for m in range(n):
                root = inverse_root(W[m + R2])
                W[m + K] = rates[low + m] * (p[i] + p[np.uint32(J[m])]) * (root * np.sqrt(root))
            _scatter(axes, J, n, i, W, F)
