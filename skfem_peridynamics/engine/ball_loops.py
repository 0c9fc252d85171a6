"""Compiled loops over ball bonds, an element at a time: all bonds of a task that end in it.

A P1 field is affine in an element: at the far end it is ``u0 + G (y - corner)``, and u0 and G are kept in a table E
with rows ``corner, u0, G``, made once for all bonds. An element is read once for its bonds, and sums their forces and
the moments of these about its corner in a row of M, which it hands to its vertices at the end. Sites, and what they
sum, are small tables of the task: rows ``x, u`` (from 0 and 4) and rows of forces.

A bond is two numbers: its site, and its vector among the ``vectors`` of the task, rows ``xi, 1 / r^3`` (0 on a ray that
left the body at once). With ``s = xi.(u_y - u_x)`` a bond has ``c = s / r^3`` and ``q = s c``. ``axes`` is a tuple as
long as the dimension. ``lists`` are the elements, where the bonds of each start, and site and vector of each bond.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .element_loops import give_back, settle
from .law_loops import BATCH, R2, ROOM, XI, YI, ZI, C, K, Q, S, bend, stored


@compiled
def _gather(
    axes: Any, at: int, low: int, n: int, site: Any, code: Any, vectors: Any, sites: Any, E: Any, m: int, W: Any
) -> None:
    """``y - corner``, ``s = xi.(u_y - u_x)`` and ``1 / r^3`` of n bonds of an element, from place m on."""
    dim = len(axes)
    # read once: what is stored below could be these, for all the compiler knows
    if dim == 1:
        c0, u0, g00 = E[at, 0], E[at, 1], E[at, 2]
        for bond in range(low, low + n):
            i, v = np.uint32(site[bond]), np.uint32(code[bond])
            x0 = vectors[v, 0]
            a = sites[i, 0] + x0 - c0
            W[m + S] = x0 * (u0 + g00 * a - sites[i, 4])
            W[m + XI] = a
            W[m + R2] = vectors[v, 3]
            m += 1
    elif dim == 2:
        c0, c1, u0, u1 = E[at, 0], E[at, 1], E[at, 2], E[at, 3]
        g00, g01, g10, g11 = E[at, 4], E[at, 5], E[at, 6], E[at, 7]
        for bond in range(low, low + n):
            i, v = np.uint32(site[bond]), np.uint32(code[bond])
            x0, x1, inverse = vectors[v, 0], vectors[v, 1], vectors[v, 3]
            # (a, b) is the far end from the corner of its element; the field there is u0 + G (a, b)
            a, b = sites[i, 0] + x0 - c0, sites[i, 1] + x1 - c1
            # s = xi.(u_y - u_x)
            s = x0 * (u0 + (g00 * a + g01 * b) - sites[i, 4])
            s += x1 * (u1 + (g10 * a + g11 * b) - sites[i, 5])
            W[m + XI] = a
            W[m + YI] = b
            W[m + S] = s
            W[m + R2] = inverse
            m += 1
    else:
        c0, c1, c2, u0, u1, u2 = E[at, 0], E[at, 1], E[at, 2], E[at, 3], E[at, 4], E[at, 5]
        g00, g01, g02 = E[at, 6], E[at, 7], E[at, 8]
        g10, g11, g12 = E[at, 9], E[at, 10], E[at, 11]
        g20, g21, g22 = E[at, 12], E[at, 13], E[at, 14]
        for bond in range(low, low + n):
            i, v = np.uint32(site[bond]), np.uint32(code[bond])
            x0, x1, x2, inverse = vectors[v, 0], vectors[v, 1], vectors[v, 2], vectors[v, 3]
            a, b, c = sites[i, 0] + x0 - c0, sites[i, 1] + x1 - c1, sites[i, 2] + x2 - c2
            s = x0 * (u0 + (g00 * a + g01 * b + g02 * c) - sites[i, 4])
            s += x1 * (u1 + (g10 * a + g11 * b + g12 * c) - sites[i, 5])
            s += x2 * (u2 + (g20 * a + g21 * b + g22 * c) - sites[i, 6])
            W[m + XI] = a
            W[m + YI] = b
            W[m + ZI] = c
            W[m + S] = s
            W[m + R2] = inverse
            m += 1


@compiled
def _pull(n: int, given: Any, low: int, scale: float, W: Any) -> None:
    """``c = s / r^3`` and ``q = s c``, and the measures."""
    for m in range(n):
        s = W[m + S]
        c = s * W[m + R2]
        W[m + C] = c
        W[m + Q] = s * c
        W[m + K] = scale * given[low + m]


@compiled
def _scatter(
    axes: Any,
    at: int,
    low: int,
    n: int,
    site: Any,
    code: Any,
    vectors: Any,
    forces: Any,
    both: bool,
    m: int,
    W: Any,
    M: Any,
) -> None:
    """Add ``k xi`` at the sites; take it, and its moment about the corner, off the element (where it acts on both)."""
    dim = len(axes)
    f0, f1, f2 = 0.0, 0.0, 0.0
    # sums of a run of bonds stay in registers: an element is written once, however many bonds end in it
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for bond in range(low, low + n):
        i, v, g = np.uint32(site[bond]), np.uint32(code[bond]), W[m + K]
        a, x = g * vectors[v, 0], W[m + XI]
        forces[i, 0] += a
        f0 += a
        m00 += a * x
        if dim > 1:
            b, y = g * vectors[v, 1], W[m + YI]
            forces[i, 1] += b
            f1 += b
            m01 += a * y
            m10 += b * x
            m11 += b * y
        if dim > 2:
            c, z = g * vectors[v, 2], W[m + ZI]
            forces[i, 2] += c
            f2 += c
            m02 += a * z
            m12 += b * z
            m20 += c * x
            m21 += c * y
            m22 += c * z
        m += 1
    # a one-sided rule acts on x only
    if both:
        M[at, 0] -= f0
        if dim == 1:
            M[at, 1] -= m00
        elif dim == 2:
            M[at, 1] -= f1
            M[at, 2] -= m00
            M[at, 3] -= m01
            M[at, 4] -= m10
            M[at, 5] -= m11
        else:
            M[at, 1] -= f1
            M[at, 2] -= f2
            M[at, 3] -= m00
            M[at, 4] -= m01
            M[at, 5] -= m02
            M[at, 6] -= m10
            M[at, 7] -= m11
            M[at, 8] -= m12
            M[at, 9] -= m20
            M[at, 10] -= m21
            M[at, 11] -= m22


@compiled
def _gather_batch(
    axes: Any,
    e: int,
    low: int,
    n: int,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    sites: Any,
    E: Any,
    W: Any,
) -> None:
    """Gather n bonds from ``low`` on, the first of them of the e-th element."""
    done = low
    while done < low + n:
        stop = min(start[e + 1], low + n)
        _gather(axes, elements[e], done, stop - done, site, code, vectors, sites, E, done - low, W)
        done = stop
        e += 1


@compiled
def _scatter_batch(
    axes: Any,
    e: int,
    low: int,
    n: int,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    forces: Any,
    both: bool,
    W: Any,
    M: Any,
) -> int:
    """Scatter them; return the element of the next bond."""
    done = low
    while done < low + n:
        stop = min(start[e + 1], low + n)
        _scatter(axes, elements[e], done, stop - done, site, code, vectors, forces, both, done - low, W, M)
        done = stop
        if done == start[e + 1]:
            e += 1
    return e


@compiled
def _past(e: int, start: Any, end: int) -> int:
    """The element of the bond ``end``."""
    while e < len(start) - 1 and start[e + 1] <= end:
        e += 1
    return e


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
    law: Any,
    both: bool,
    M: Any,
) -> None:
    """Add the forces of the bonds to the element sums M."""
    W, sites, forces = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 4))
    # sites: place and displacement of the outer points, in a small table that stays in cache
    settle(axes, x, own, E, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _pull(n, given, low, scale, W)
        bend(kind, slope, b, law, W, n)
        e = _scatter_batch(axes, e, low, n, elements, start, site, code, vectors, forces, both, W, M)
    # bonds of a one-sided rule come in one order: their force at x counts twice
    give_back(axes, x, own, E, forces, 1.0 if both else 2.0, M)


@compiled
def energy(
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
) -> float:
    """Return the energy of the bonds."""
    W, sites = np.empty(ROOM), np.empty((len(own), 8))
    settle(axes, x, own, E, sites)
    total, e = 0.0, 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _pull(n, given, low, scale, W)
        total += stored(kind, slope, b, law, W, n)
        e = _past(e, start, low + n)
    return total


@compiled
def strains(
    axes: Any, x: Any, own: Any, elements: Any, start: Any, site: Any, code: Any, vectors: Any, E: Any, T: Any
) -> None:
    """Write the scaled strains ``T = s / r^(3/2)`` of the bonds."""
    W, sites = np.empty(ROOM), np.empty((len(own), 8))
    settle(axes, x, own, E, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        for m in range(n):
            T[low + m] = W[m + S] * np.sqrt(W[m + R2])
        e = _past(e, start, low + n)


@compiled
def product(
    axes: Any,
    x: Any,
    own: Any,
    elements: Any,
    start: Any,
    site: Any,
    code: Any,
    vectors: Any,
    E: Any,
    weight: Any,
    both: bool,
    M: Any,
) -> None:
    """Take ``X^T diag(weight) B u`` off the element sums M, B the map from displacements to scaled strains."""
    W, sites, forces = np.empty(ROOM), np.empty((len(own), 8)), np.zeros((len(own), 4))
    settle(axes, x, own, E, sites)
    e = 0
    for low in range(0, len(site), BATCH):
        n = min(BATCH, len(site) - low)
        _gather_batch(axes, e, low, n, elements, start, site, code, vectors, sites, E, W)
        _pull(n, weight, low, 1.0, W)
        for m in range(n):
            W[m + K] *= W[m + C]
        e = _scatter_batch(axes, e, low, n, elements, start, site, code, vectors, forces, both, W, M)
    give_back(axes, x, own, E, forces, 1.0 if both else 2.0, M)
