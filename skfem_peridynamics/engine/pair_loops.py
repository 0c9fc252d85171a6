"""Compiled loops over pairs of samples: a row of far ends for each near end, a batch at a time.

A batch is gathered (bond vectors, relative displacements), goes through the law in loops that vectorise, and is
scattered. Samples come as a table with rows ``x, volume, u, 1 / size``, so that all a bond needs of its far end lies
in one cache line; ``axes`` is a tuple as long as the dimension, known when a loop is compiled. Where no measures are
stored (``k`` is None) they are made of volumes and sizes as
:class:`~skfem_peridynamics.bonds.pair_bonds.PairBonds` makes them. Forces are summed in rows, one a component:
``F[a]``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .law_loops import BATCH, R2, REST, ROOM, XI, YI, ZI, C, K, Q, S, bend, inverse_root, multiplied, snap, stored


@compiled
def _gather(axes: Any, J: Any, n: int, i: int, P: Any, given: Any, W: Any) -> None:
    """Bond vectors, ``s = xi.(u_y - u_x)``, r^2 and, where no measures are given, volumes and inverse sizes."""
    dim = len(axes)
    # read once: what is stored below could be these, for all the compiler knows
    x0, y0, z0 = P[i, 0], P[i, dim // 2], P[i, dim - 1]
    u0, v0, w0 = P[i, dim + 1], P[i, dim + 1 + dim // 2], P[i, 2 * dim]
    for m in range(n):
        # an unsigned index needs no test for counting from the end
        j = np.uint32(J[m])
        d = P[j, 0] - x0
        # the branches on the dimension are gone once ``axes`` is known
        along = d * (P[j, dim + 1] - u0)
        length = d * d
        W[m + XI] = d
        if dim > 1:
            d = P[j, 1] - y0
            along += d * (P[j, dim + 2] - v0)
            length += d * d
            W[m + YI] = d
        if dim > 2:
            d = P[j, 2] - z0
            along += d * (P[j, dim + 3] - w0)
            length += d * d
            W[m + ZI] = d
        W[m + S] = along
        W[m + R2] = length
        if given is None:
            W[m + K] = P[j, dim]
            W[m + REST] = P[j, 2 * dim + 1]


@compiled
def _pull(n: int, given: Any, scale: float, W: Any) -> None:
    """``c = s / r^3`` and ``q = s c``; the measures k are given."""
    for m in range(n):
        root = inverse_root(W[m + R2])
        s = W[m + S]
        c = s * (root * root * root)
        W[m + C] = c
        W[m + Q] = s * c
        W[m + K] = scale * given[m]


@compiled
def cell_share(short: float, rest: float, own: float, least: float) -> float:
    """Twice the part of two cells that lies in each other's ball, by ``short`` of the rim and their inverse sizes.

    ``clip((reach - r) / h + 1/2, 0, 1)`` of either; ``least`` 1 counts pairs fully.
    """
    return min(max(short * rest + 0.5, least), 1.0) + min(max(short * own + 0.5, least), 1.0)


@compiled
def _pull_cells(n: int, reach: float, own: float, own_size: float, W: Any) -> None:
    """The same where k holds the volumes of the far ends and becomes the measure; ``reach`` 0 counts pairs fully."""
    least = 0.0 if reach > 0.0 else 1.0
    for m in range(n):
        root = inverse_root(W[m + R2])
        s = W[m + S]
        c = s * (root * root * root)
        W[m + C] = c
        W[m + Q] = s * c
        W[m + K] *= own * cell_share(reach - W[m + R2] * root, W[m + REST], own_size, least)


@compiled
def _batch(axes: Any, J: Any, n: int, i: int, P: Any, given: Any, low: int, reach: float, scale: float, W: Any) -> None:
    """Everything about a batch that comes before the law."""
    dim = len(axes)
    _gather(axes, J, n, i, P, given, W)
    if given is None:
        _pull_cells(n, reach, scale * P[i, dim], P[i, 2 * dim + 1], W)
    else:
        _pull(n, given[low : low + n], scale, W)


@compiled
def _take_off(axes: Any, J: Any, n: int, W: Any, X: Any, Y: Any, Z: Any) -> None:
    for m in range(n):
        j = np.uint32(J[m])
        X[j] -= W[m + XI]
        if len(axes) > 1:
            Y[j] -= W[m + YI]
        if len(axes) > 2:
            Z[j] -= W[m + ZI]


@compiled
def _scatter(axes: Any, J: Any, n: int, i: int, W: Any, F: Any) -> None:
    """Add ``k xi`` at the near end, take it off the far ends."""
    X, Y, Z = F
    # the row keeps one near end: its sum is made in registers and stored once
    X[i] += multiplied(W, XI, n)
    if len(axes) > 1:
        Y[i] += multiplied(W, YI, n)
    if len(axes) > 2:
        Z[i] += multiplied(W, ZI, n)
    _take_off(axes, J, n, W, X, Y, Z)


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
    own: Any,
    F: Any,
    limit: Any = None,
    both: bool = True,
) -> int:
    """Add the forces of the bonds to F, three rows (of which the last are not used in 1D and 2D).

    Bonds beyond a ``limit`` break; return how many, see :func:`~.law_loops.snap`.
    """
    W = np.empty(ROOM)
    count = 0
    for row in range(len(start) - 1):
        i = first + row
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _batch(axes, J, n, i, P, given, low, reach, scale, W)
            # numba drops this branch where the loop is compiled without a limit
            if limit is not None:
                count += snap(limit, both, W, given, low, n)
            bend(kind, slope, b, own, W, n)
            _scatter(axes, J, n, i, W, F)
    return count


@compiled
def energy(
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
) -> float:
    """Return the energy of the bonds."""
    W = np.empty(ROOM)
    total = 0.0
    for row in range(len(start) - 1):
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            _batch(axes, far[low : low + n], n, first + row, P, given, low, reach, scale, W)
            total += stored(kind, slope, b, own, W, n)
    return total


@compiled
def strains(axes: Any, start: Any, far: Any, first: int, P: Any, T: Any) -> None:
    """Write the scaled strains ``T = s / r^(3/2)`` of the bonds."""
    W = np.empty(ROOM)
    for row in range(len(start) - 1):
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            # T in place of measures: it is not read, and no volumes are gathered
            _gather(axes, far[low : low + n], n, first + row, P, T, W)
            for m in range(n):
                root = inverse_root(W[m + R2])
                T[low + m] = W[m + S] * (root * np.sqrt(root))


@compiled
def product(axes: Any, start: Any, far: Any, first: int, P: Any, weight: Any, F: Any) -> None:
    """Take ``B^T diag(weight) B u`` off F, B the map from displacements to scaled strains."""
    W = np.empty(ROOM)
    for row in range(len(start) - 1):
        for low in range(start[row], start[row + 1], BATCH):
            n = min(BATCH, start[row + 1] - low)
            J = far[low : low + n]
            _gather(axes, J, n, first + row, P, weight, W)
            _pull(n, weight[low : low + n], 1.0, W)
            for m in range(n):
                W[m + K] *= W[m + C]
            _scatter(axes, J, n, first + row, W, F)
