"""Compiled loops over ball bonds, a site at a time: its rays, their nodes, and the elements these lie in.

An element has a row of a table, whole lines of the cache: its first corner, the gradients of the other barycentric
coordinates, and (in ``ids``, the same memory read as integers) the numbers of its corners. Displacements and forces
are rows of small tables of vertices, which stay in cache whatever the number of bonds. With ``t = e.(u_y - u_x)`` a
bond has ``c = t / r`` and ``q = t c``. ``axes`` is a tuple as long as the dimension.

All loops share some arguments: points x (nsites, 3) and ``own`` element of the sites, ``reach`` (nsites, ndir),
``element`` (nsites, ndir, nrad), and of the fan ``way`` (ndir, 3), unit vectors, and ``node`` (2, 2, nrad), distances
as fractions of the reach and their inverses, on rays of full length and on rays cut short.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .law_loops import BATCH, R2, ROOM, XI, YI, ZI, C, K, Q, S, bend, stored

IDS = (0, 4, 12, 24)  # where the corners start among the integers of a row, by dimension


@compiled
def _place(axes: Any, a: float, b: float, c: float, E: Any, at: int) -> tuple[float, float, float]:
    """Barycentric coordinates 1, 2, 3 of a point in an element."""
    if len(axes) == 1:
        return (a - E[at, 0]) * E[at, 1], 0.0, 0.0
    if len(axes) == 2:
        a, b = a - E[at, 0], b - E[at, 1]
        return E[at, 2] * a + E[at, 3] * b, E[at, 4] * a + E[at, 5] * b, 0.0
    a, b, c = a - E[at, 0], b - E[at, 1], c - E[at, 2]
    return (
        E[at, 3] * a + E[at, 4] * b + E[at, 5] * c,
        E[at, 6] * a + E[at, 7] * b + E[at, 8] * c,
        E[at, 9] * a + E[at, 10] * b + E[at, 11] * c,
    )


@compiled
def _along(axes: Any, u: Any, v: int, e0: float, e1: float, e2: float) -> float:
    """``e.u`` at a vertex."""
    t = e0 * u[v, 0]
    if len(axes) > 1:
        t += e1 * u[v, 1]
    if len(axes) > 2:
        t += e2 * u[v, 2]
    return t


@compiled
def _between(
    axes: Any, u: Any, ids: Any, at: int, p: float, q: float, r: float, e0: float, e1: float, e2: float
) -> float:
    """``e.u`` at a point of an element, from differences: exactly that of a corner where all corners move alike."""
    first = IDS[len(axes)]
    t0 = _along(axes, u, np.uint32(ids[at, first]), e0, e1, e2)
    t = t0 + p * (_along(axes, u, np.uint32(ids[at, first + 1]), e0, e1, e2) - t0)
    if len(axes) > 1:
        t += q * (_along(axes, u, np.uint32(ids[at, first + 2]), e0, e1, e2) - t0)
    if len(axes) > 2:
        t += r * (_along(axes, u, np.uint32(ids[at, first + 3]), e0, e1, e2) - t0)
    return t


@compiled
def _gather(
    axes: Any,
    row: int,
    x: Any,
    own: Any,
    reach: Any,
    element: Any,
    horizon: float,
    way: Any,
    node: Any,
    E: Any,
    ids: Any,
    u: Any,
    ray: int,
    end: int,
    W: Any,
) -> None:
    """Barycentric coordinates of y, ``t = e.(u_y - u_x)`` and ``1 / r`` (0 on a ray that left at once)."""
    nrad = element.shape[2]
    x0, x1, x2 = x[row, 0], x[row, 1], x[row, 2]
    home = np.uint32(own[row])
    p0, q0, r0 = _place(axes, x0, x1, x2, E, home)
    m = 0
    for d in range(ray, end):
        length = reach[row, d]
        cut = 1 if length < horizon else 0
        inverse = 0.0 if length == 0.0 else 1.0 / length
        e0, e1, e2 = way[d, 0], way[d, 1], way[d, 2]
        here = _between(axes, u, ids, home, p0, q0, r0, e0, e1, e2)
        for k in range(nrad):
            at = np.uint32(element[row, d, k])
            s = length * node[0, cut, k]
            p, q, r = _place(axes, x0 + s * e0, x1 + s * e1, x2 + s * e2, E, at)
            W[m + S] = _between(axes, u, ids, at, p, q, r, e0, e1, e2) - here
            W[m + XI] = p
            if len(axes) > 1:
                W[m + YI] = q
            if len(axes) > 2:
                W[m + ZI] = r
            W[m + R2] = inverse * node[1, cut, k]
            m += 1


@compiled
def _pull(n: int, given: Any, at: int, scale: float, W: Any) -> None:
    """``c = t / r`` and ``q = t c``, and the measures."""
    for m in range(n):
        t = W[m + S]
        c = t * W[m + R2]
        W[m + C] = c
        W[m + Q] = t * c
        W[m + K] = scale * given[at + m]


@compiled
def _hand(axes: Any, F: Any, v: int, g: float, e0: float, e1: float, e2: float) -> None:
    """Take ``g e`` off a vertex."""
    F[v, 0] -= g * e0
    if len(axes) > 1:
        F[v, 1] -= g * e1
    if len(axes) > 2:
        F[v, 2] -= g * e2


@compiled
def _hand_out(
    axes: Any, F: Any, ids: Any, at: int, g: float, p: float, q: float, r: float, e0: float, e1: float, e2: float
) -> None:
    """Take ``g e`` at a point of an element off its corners."""
    first = IDS[len(axes)]
    g1, g2, g3 = g * p, g * q, g * r
    g0 = g - g1
    if len(axes) > 1:
        g0 -= g2
    if len(axes) > 2:
        g0 -= g3
    _hand(axes, F, np.uint32(ids[at, first]), g0, e0, e1, e2)
    _hand(axes, F, np.uint32(ids[at, first + 1]), g1, e0, e1, e2)
    if len(axes) > 1:
        _hand(axes, F, np.uint32(ids[at, first + 2]), g2, e0, e1, e2)
    if len(axes) > 2:
        _hand(axes, F, np.uint32(ids[at, first + 3]), g3, e0, e1, e2)


@compiled
def _scatter(
    axes: Any,
    row: int,
    x: Any,
    own: Any,
    element: Any,
    way: Any,
    ray: int,
    end: int,
    both: bool,
    E: Any,
    ids: Any,
    W: Any,
    F: Any,
) -> None:
    """Add ``k e`` at the site; take it off the far end, where it acts on both."""
    nrad = element.shape[2]
    fx, fy, fz = 0.0, 0.0, 0.0
    m = 0
    for d in range(ray, end):
        e0, e1, e2 = way[d, 0], way[d, 1], way[d, 2]
        whole = 0.0
        for k in range(nrad):
            g = W[m + K]
            whole += g
            if both:
                at = np.uint32(element[row, d, k])
                _hand_out(axes, F, ids, at, g, W[m + XI], W[m + YI], W[m + ZI], e0, e1, e2)
            m += 1
        fx += whole * e0
        fy += whole * e1
        fz += whole * e2
    home, times = np.uint32(own[row]), -1.0 if both else -2.0
    p, q, r = _place(axes, x[row, 0], x[row, 1], x[row, 2], E, home)
    _hand_out(axes, F, ids, home, times, p, q, r, fx, fy, fz)


@compiled
def force(
    axes: Any,
    x: Any,
    own: Any,
    reach: Any,
    element: Any,
    horizon: float,
    way: Any,
    node: Any,
    E: Any,
    ids: Any,
    u: Any,
    given: Any,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    law: Any,
    both: bool,
    F: Any,
) -> None:
    """Add the forces of the bonds to F."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            n = (end - ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ids, u, ray, end, W)
            _pull(n, given, (row * ndir + ray) * nrad, scale, W)
            bend(kind, slope, b, law, W, n)
            _scatter(axes, row, x, own, element, way, ray, end, both, E, ids, W, F)


@compiled
def energy(
    axes: Any,
    x: Any,
    own: Any,
    reach: Any,
    element: Any,
    horizon: float,
    way: Any,
    node: Any,
    E: Any,
    ids: Any,
    u: Any,
    given: Any,
    scale: float,
    kind: int,
    slope: float,
    b: float,
    law: Any,
) -> float:
    """Return the energy of the bonds."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    total = 0.0
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            n = (end - ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ids, u, ray, end, W)
            _pull(n, given, (row * ndir + ray) * nrad, scale, W)
            total += stored(kind, slope, b, law, W, n)
    return total


@compiled
def strains(
    axes: Any,
    x: Any,
    own: Any,
    reach: Any,
    element: Any,
    horizon: float,
    way: Any,
    node: Any,
    E: Any,
    ids: Any,
    u: Any,
    T: Any,
) -> None:
    """Write the scaled strains ``T = t / sqrt(r)`` of the bonds."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            at = (row * ndir + ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ids, u, ray, end, W)
            for m in range((end - ray) * nrad):
                T[at + m] = W[m + S] * np.sqrt(W[m + R2])


@compiled
def product(
    axes: Any,
    x: Any,
    own: Any,
    reach: Any,
    element: Any,
    horizon: float,
    way: Any,
    node: Any,
    E: Any,
    ids: Any,
    u: Any,
    weight: Any,
    both: bool,
    F: Any,
) -> None:
    """Take ``X^T diag(weight) B u`` off F, B the map from displacements to scaled strains."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            n = (end - ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ids, u, ray, end, W)
            _pull(n, weight, (row * ndir + ray) * nrad, 1.0, W)
            for m in range(n):
                W[m + K] *= W[m + C]
            _scatter(axes, row, x, own, element, way, ray, end, both, E, ids, W, F)
