"""Compiled loops over ball bonds for a body with a dilatation: the virial first, then forces under its pressure.

They gather as :mod:`~skfem_peridynamics.engine.ball_loops` does. V has a row for each element, the virial of its bonds
and the moments of it about the corner; p a row ``p0, gradient`` of the pressure there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .ball_loops import _gather_batch, _pull, _scatter_batch
from .element_loops import give_back, settle
from .law_loops import BATCH, R2, REST, ROOM, XI, YI, ZI, K, S, bend
from .virial_loops import _bend_pressed


@compiled
def tabulate(axes: Any, corners: Any, gradient: Any, nodal: Any, low: int, high: int, p: Any) -> None:
    """Fill in p0 and the gradient of some elements from nodal values."""
    dim = len(axes)
    for e in range(low, high):
        p0 = nodal[corners[0, e]]
        p[e, 0] = p0
        for b in range(dim):
            slope = 0.0
            for k in range(1, dim + 1):
                slope += (nodal[corners[k, e]] - p0) * gradient[e, k, b]
            p[e, 1 + b] = slope


@compiled
def hand_over(axes: Any, corners: Any, gradient: Any, V: Any, low: int, high: int, nodal: Any) -> None:
    """Add what some elements have summed to nodal values, by P1 values at their corners; empty the sums."""
    dim = len(axes)
    for e in range(low, high):
        rest = V[e, 0]
        V[e, 0] = 0.0
        for k in range(1, dim + 1):
            part = 0.0
            for b in range(dim):
                part += V[e, 1 + b] * gradient[e, k, b]
            nodal[corners[k, e]] += part
            rest -= part
        for b in range(dim):
            V[e, 1 + b] = 0.0
        nodal[corners[0, e]] += rest


@compiled
def _squared(axes: Any, v: int, vectors: Any) -> float:
    x = vectors[v, 0]
    total = x * x
    if len(axes) > 1:
        x = vectors[v, 1]
        total += x * x
    if len(axes) > 2:
        x = vectors[v, 2]
        total += x * x
    return total  # type: ignore[no-any-return]


@compiled
def _lengths(axes: Any, low: int, n: int, code: Any, vectors: Any, W: Any) -> None:
    """``r^2 / 2`` times K, in K: what a bond pulls with times its length, from ``2 k f' c``."""
    for m in range(n):
        W[m + K] *= 0.5 * _squared(axes, np.uint32(code[low + m]), vectors)


@compiled
def _add(axes: Any, at: int, low: int, n: int, site: Any, sums: Any, m: int, W: Any, V: Any) -> None:
    """Add K at the sites, and with its moment about the corner to the element."""
    dim = len(axes)
    total, first, second, third = 0.0, 0.0, 0.0, 0.0
    for bond in range(low, low + n):
        pull = W[m + K]
        sums[np.uint32(site[bond]), 0] += pull
        total += pull
        first += pull * W[m + XI]
        if dim > 1:
            second += pull * W[m + YI]
        if dim > 2:
            third += pull * W[m + ZI]
        m += 1
    V[at, 0] += total
    V[at, 1] += first
    if dim > 1:
        V[at, 2] += second
    if dim > 2:
        V[at, 3] += third


@compiled
def _add_batch(
    axes: Any, e: int, low: int, n: int, elements: Any, start: Any, site: Any, sums: Any, W: Any, V: Any
) -> int:
    """Add n bonds from ``low`` on, the first of them of the e-th element; return the element of the next bond."""
    done = low
    while done < low + n:
        stop = min(start[e + 1], low + n)
        _add(axes, elements[e], done, stop - done, site, sums, done - low, W, V)
        done = stop
        if done == start[e + 1]:
            e += 1
    return e


@compiled
def _give_back(axes: Any, x: Any, own: Any, E: Any, sums: Any, V: Any) -> None:
    """Add the sums at the sites to the elements that hold them."""
    for i in range(len(own)):
        at, pull = own[i], sums[i, 0]
        V[at, 0] += pull
        for b in range(len(axes)):
            V[at, 1 + b] += pull * (x[i, b] - E[at, b])


@compiled
def _settle_pressure(axes: Any, x: Any, own: Any, E: Any, p: Any, sites: Any) -> None:
    """The pressure at the sites, in column 7."""
    for i in range(len(own)):
        at = own[i]
        value = p[at, 0]
        for b in range(len(axes)):
            value += p[at, 1 + b] * (x[i, b] - E[at, b])
        sites[i, 7] = value


@compiled
def _press(axes: Any, at: int, low: int, n: int, site: Any, sites: Any, p: Any, m: int, W: Any) -> None:
    """``p_x + p_y`` of n bonds of an element, in REST."""
    dim = len(axes)
    for bond in range(low, low + n):
        value = p[at, 0] + p[at, 1] * W[m + XI]
        if dim > 1:
            value += p[at, 2] * W[m + YI]
        if dim > 2:
            value += p[at, 3] * W[m + ZI]
        W[m + REST] = sites[np.uint32(site[bond]), 7] + value
        m += 1


@compiled
def _press_batch(
    axes: Any, e: int, low: int, n: int, elements: Any, start: Any, site: Any, sites: Any, p: Any, W: Any
) -> None:
    done = low
    while done < low + n:
        stop = min(start[e + 1], low + n)
        _press(axes, elements[e], done, stop - done, site, sites, p, done - low, W)
        done = stop
        e += 1


@compiled
def virial(
    axes: Any,
    x: Any,
    own: Any,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    E: Any,
    given: Any,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    law: Any,
    V: Any,
) -> None:
    """Add ``k sqrt(r) F1'(T) / 2`` of the bonds to V, at both ends."""
    W, sites, sums = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 1))
    settle(axes, x, own, E, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _pull(n, given, low, scale, W)
        bend(kind, slope, b, law, W, n)
        _lengths(axes, low, n, code, vectors, W)
        e = _add_batch(axes, e, low, n, elements, start, site, sums, W, V)
    _give_back(axes, x, own, E, sums, V)


@compiled
def force(
    axes: Any,
    x: Any,
    own: Any,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    E: Any,
    given: Any,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    df: Any,
    d2f: Any,
    p: Any,
    M: Any,
) -> None:
    """Add the forces of the bonds under a pressure to the element sums M."""
    W, sites, forces = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 4))
    settle(axes, x, own, E, sites)
    _settle_pressure(axes, x, own, E, p, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _pull(n, given, low, scale, W)
        _press_batch(axes, e, low, n, elements, start, site, sites, p, W)
        for m in range(n):
            # 1 / r is r^2 / r^3
            W[m + REST] *= W[m + R2] * _squared(axes, np.uint32(code[low + m]), vectors)
        _bend_pressed(kind, slope, b, df, d2f, W, n)
        e = _scatter_batch(axes, e, low, n, elements, start, site, code, vectors, forces, True, W, M)
    give_back(axes, x, own, E, forces, 1.0, M)


@compiled
def dilate(
    axes: Any,
    x: Any,
    own: Any,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    E: Any,
    rates: Any,
    V: Any,
) -> None:
    """Add ``rate T`` of the bonds to V, at both ends."""
    W, sites, sums = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 1))
    settle(axes, x, own, E, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        for m in range(n):
            W[m + K] = rates[low + m] * W[m + S] * np.sqrt(W[m + R2])
        e = _add_batch(axes, e, low, n, elements, start, site, sums, W, V)
    _give_back(axes, x, own, E, sums, V)


@compiled
def squeeze(
    axes: Any,
    x: Any,
    own: Any,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    E: Any,
    rates: Any,
    p: Any,
    M: Any,
) -> None:
    """Add ``rate (p_x + p_y) xi / r^(3/2)`` to M: minus the transpose of :func:`dilate`."""
    W, sites, forces = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 4))
    settle(axes, x, own, E, sites)
    _settle_pressure(axes, x, own, E, p, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _press_batch(axes, e, low, n, elements, start, site, sites, p, W)
        for m in range(n):
            W[m + K] = rates[low + m] * W[m + REST] * np.sqrt(W[m + R2])
        e = _scatter_batch(axes, e, low, n, elements, start, site, code, vectors, forces, True, W, M)
    give_back(axes, x, own, E, forces, 1.0, M)
