"""Compiled loops over ball bonds, a site at a time: its rays, their nodes, and the elements these lie in.

A P1 field is affine in an element: at the far end it is ``u0 + G (y - corner)``, and u0 and G are kept in a table with
rows ``corner, u0, G``, made once for all bonds. Forces go back the same way: an element sums forces and their moments
about its corner, and hands them to its vertices at the end. With ``t = e.(u_y - u_x)`` a bond has ``c = t / r`` and
``q = t c``. ``axes`` is a tuple as long as the dimension; sites come as a table with rows ``x, volume, u, 1 / size``.
``way`` (3, nbonds) and ``node`` (2, nbonds) are what all sites share: directions, and distances as fractions of the
reach on rays of full length and on rays cut short.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .law_loops import BATCH, R2, REST, ROWS, XI, C, K, Q, S, bend, stored


@compiled
def _along(reach: Any, horizon: float, nrad: int, node: Any, low: int, n: int, W: Any) -> None:
    """Lengths of the bonds of some rays, and their inverses (0 where a ray left the body at once)."""
    m = 0
    for ray in range(n // nrad):
        length = reach[ray]
        cut = 1 if length < horizon else 0
        inverse = 0.0 if length == 0.0 else 1.0 / length
        for _ in range(nrad):
            W[m + REST] = length * node[cut, low + m]
            W[m + R2] = inverse / node[cut, low + m]
            m += 1


@compiled
def _gather(axes: Any, element: Any, n: int, i: int, P: Any, E: Any, way: Any, low: int, W: Any) -> None:
    """``y - corner`` of each bond and ``t = e.(u_y - u_x)``."""
    dim = len(axes)
    x0, y0, z0 = P[i, 0], P[i, dim // 2], P[i, dim - 1]
    u0, v0, w0 = P[i, dim + 1], P[i, dim + 1 + dim // 2], P[i, 2 * dim]
    for m in range(n):
        at = np.uint32(element[m])
        r = W[m + REST]
        if dim == 1:
            a = x0 + r * way[0, low + m] - E[at, 0]
            W[m + XI] = a
            t = way[0, low + m] * (E[at, 1] + E[at, 2] * a - u0)
        elif dim == 2:
            e0, e1 = way[0, low + m], way[1, low + m]
            a = x0 + r * e0 - E[at, 0]
            b = y0 + r * e1 - E[at, 1]
            W[m + XI] = a
            W[m + (XI + BATCH)] = b
            t = e0 * (E[at, 2] + (E[at, 4] * a + E[at, 5] * b) - u0)
            t += e1 * (E[at, 3] + (E[at, 6] * a + E[at, 7] * b) - v0)
        else:
            e0, e1, e2 = way[0, low + m], way[1, low + m], way[2, low + m]
            a = x0 + r * e0 - E[at, 0]
            b = y0 + r * e1 - E[at, 1]
            c = z0 + r * e2 - E[at, 2]
            W[m + XI] = a
            W[m + (XI + BATCH)] = b
            W[m + (XI + 2 * BATCH)] = c
            t = e0 * (E[at, 3] + (E[at, 6] * a + E[at, 7] * b + E[at, 8] * c) - u0)
            t += e1 * (E[at, 4] + (E[at, 9] * a + E[at, 10] * b + E[at, 11] * c) - v0)
            t += e2 * (E[at, 5] + (E[at, 12] * a + E[at, 13] * b + E[at, 14] * c) - w0)
        W[m + S] = t


@compiled
def _pull(n: int, given: Any, scale: float, W: Any) -> None:
    """``c = t / r`` and ``q = t c``, and the measures."""
    for m in range(n):
        t = W[m + S]
        c = t * W[m + R2]
        W[m + C] = c
        W[m + Q] = t * c
        W[m + K] = scale * given[m]


@compiled
def _scatter(axes: Any, element: Any, n: int, i: int, way: Any, low: int, both: bool, W: Any, F: Any, M: Any) -> None:
    """Add ``k e`` at the site; take it, and its moment about the corner, off the element (where it acts on both)."""
    dim = len(axes)
    X, Y, Z = F
    fx, fy, fz = 0.0, 0.0, 0.0
    for m in range(n):
        at = np.uint32(element[m])
        g = W[m + K]
        if dim == 1:
            a = g * way[0, low + m]
            fx += a
            if both:
                M[at, 0] -= a
                M[at, 1] -= a * W[m + XI]
        elif dim == 2:
            a, b = g * way[0, low + m], g * way[1, low + m]
            fx += a
            fy += b
            if both:
                p, q = W[m + XI], W[m + (XI + BATCH)]
                M[at, 0] -= a
                M[at, 1] -= b
                M[at, 2] -= a * p
                M[at, 3] -= a * q
                M[at, 4] -= b * p
                M[at, 5] -= b * q
        else:
            a, b, c = g * way[0, low + m], g * way[1, low + m], g * way[2, low + m]
            fx += a
            fy += b
            fz += c
            if both:
                p, q, r = W[m + XI], W[m + (XI + BATCH)], W[m + (XI + 2 * BATCH)]
                M[at, 0] -= a
                M[at, 1] -= b
                M[at, 2] -= c
                M[at, 3] -= a * p
                M[at, 4] -= a * q
                M[at, 5] -= a * r
                M[at, 6] -= b * p
                M[at, 7] -= b * q
                M[at, 8] -= b * r
                M[at, 9] -= c * p
                M[at, 10] -= c * q
                M[at, 11] -= c * r
    twice = 1.0 if both else 2.0
    X[i] += twice * fx
    if dim > 1:
        Y[i] += twice * fy
    if dim > 2:
        Z[i] += twice * fz


@compiled
def force(axes: Any, site: Any, first: int, reach: Any, element: Any, horizon: float, way: Any, node: Any, P: Any,
          E: Any, given: Any, scale: float, kind: int, slope: float, b: float, own: Any, both: bool, F: Any,
          M: Any) -> None:
    """Add the forces of the bonds to F, three rows, and to the element sums M."""
    W = np.empty(ROWS * BATCH)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(site)):
        i = first + site[row]
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            low, n = ray * nrad, (end - ray) * nrad
            at = row * ndir * nrad + low
            far = element[row, ray:end].reshape(-1)
            _along(reach[row, ray:end], horizon, nrad, node, low, n, W)
            _gather(axes, far, n, i, P, E, way, low, W)
            _pull(n, given[at : at + n], scale, W)
            bend(kind, slope, b, own, W, n)
            _scatter(axes, far, n, i, way, low, both, W, F, M)


@compiled
def energy(axes: Any, site: Any, first: int, reach: Any, element: Any, horizon: float, way: Any, node: Any, P: Any,
           E: Any, given: Any, scale: float, kind: int, slope: float, b: float, own: Any) -> float:
    """Return the energy of the bonds."""
    W = np.empty(ROWS * BATCH)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    total = 0.0
    for row in range(len(site)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            low, n = ray * nrad, (end - ray) * nrad
            at = row * ndir * nrad + low
            _along(reach[row, ray:end], horizon, nrad, node, low, n, W)
            _gather(axes, element[row, ray:end].reshape(-1), n, first + site[row], P, E, way, low, W)
            _pull(n, given[at : at + n], scale, W)
            total += stored(kind, slope, b, own, W, n)
    return total


@compiled
def strains(axes: Any, site: Any, first: int, reach: Any, element: Any, horizon: float, way: Any, node: Any, P: Any,
            E: Any, T: Any) -> None:
    """Write the scaled strains ``T = t / sqrt(r)`` of the bonds."""
    W = np.empty(ROWS * BATCH)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(site)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            low, n = ray * nrad, (end - ray) * nrad
            at = row * ndir * nrad + low
            _along(reach[row, ray:end], horizon, nrad, node, low, n, W)
            _gather(axes, element[row, ray:end].reshape(-1), n, first + site[row], P, E, way, low, W)
            for m in range(n):
                T[at + m] = W[m + S] * np.sqrt(W[m + R2])


@compiled
def product(axes: Any, site: Any, first: int, reach: Any, element: Any, horizon: float, way: Any, node: Any, P: Any,
            E: Any, weight: Any, both: bool, F: Any, M: Any) -> None:
    """Take ``X^T diag(weight) B u`` off F and M, B the map from displacements to scaled strains."""
    W = np.empty(ROWS * BATCH)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(site)):
        i = first + site[row]
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            low, n = ray * nrad, (end - ray) * nrad
            at = row * ndir * nrad + low
            far = element[row, ray:end].reshape(-1)
            _along(reach[row, ray:end], horizon, nrad, node, low, n, W)
            _gather(axes, far, n, i, P, E, way, low, W)
            _pull(n, weight[at : at + n], 1.0, W)
            for m in range(n):
                W[m + K] *= W[m + C]
            _scatter(axes, far, n, i, way, low, both, W, F, M)


@compiled
def tabulate(axes: Any, corners: Any, gradient: Any, P: Any, low: int, high: int, E: Any) -> None:
    """Fill in u0 and G of some elements; ``gradient`` holds those of the barycentric coordinates."""
    dim = len(axes)
    for e in range(low, high):
        base = corners[e, 0]
        for a in range(dim):
            u0 = P[base, dim + 1 + a]
            E[e, dim + a] = u0
            for b in range(dim):
                slope = 0.0
                for k in range(1, dim + 1):
                    slope += (P[corners[e, k], dim + 1 + a] - u0) * gradient[e, k, b]
                E[e, 2 * dim + a * dim + b] = slope


@compiled
def hand_over(axes: Any, corners: Any, gradient: Any, M: Any, low: int, high: int, F: Any) -> None:
    """Add what some elements have summed to F, by P1 values at their corners."""
    dim = len(axes)
    for e in range(low, high):
        for a in range(dim):
            rest = M[e, a]
            for k in range(1, dim + 1):
                part = 0.0
                for b in range(dim):
                    part += M[e, dim + a * dim + b] * gradient[e, k, b]
                F[a, corners[e, k]] += part
                rest -= part
            F[a, corners[e, 0]] += rest
