"""Compiled loops over ball bonds, a site at a time: its rays, their nodes, and the elements these lie in.

A P1 field is affine in an element, ``u0 + G (y - corner)``: a table with rows ``corner, u0, G`` is made once for all
bonds, and both ends of a bond are read from it, the site from the element that holds it. Forces go back the same way:
an element sums forces and their moments about its corner, and hands them to its vertices at the end. With
``t = e.(u_y - u_x)`` a bond has ``c = t / r`` and ``q = t c``. ``axes`` is a tuple as long as the dimension.

All loops share some arguments: points (nsites, 3) and ``own`` element of the sites, ``reach`` (nsites, ndir),
``element`` (nsites, ndir, nrad), and of the fan ``way`` (ndir, 3), unit vectors, and ``node`` (2, 2, nrad), distances
as fractions of the reach and their inverses, on rays of full length and on rays cut short.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled
from .law_loops import BATCH, R2, ROOM, XI, YI, ZI, C, K, Q, S, bend, stored


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
    ray: int,
    end: int,
    W: Any,
) -> None:
    """``y - corner`` of the bonds on some rays, ``t = e.(u_y - u_x)`` and ``1 / r`` (0 on a ray that left at once)."""
    dim, nrad = len(axes), element.shape[2]
    x0, x1, x2 = x[row, 0], x[row, 1], x[row, 2]
    u0, u1, u2 = 0.0, 0.0, 0.0
    at = np.uint32(own[row])
    if dim == 1:
        u0 = E[at, 1] + E[at, 2] * (x0 - E[at, 0])
    elif dim == 2:
        a, b = x0 - E[at, 0], x1 - E[at, 1]
        u0 = E[at, 2] + (E[at, 4] * a + E[at, 5] * b)
        u1 = E[at, 3] + (E[at, 6] * a + E[at, 7] * b)
    else:
        a, b, c = x0 - E[at, 0], x1 - E[at, 1], x2 - E[at, 2]
        u0 = E[at, 3] + (E[at, 6] * a + E[at, 7] * b + E[at, 8] * c)
        u1 = E[at, 4] + (E[at, 9] * a + E[at, 10] * b + E[at, 11] * c)
        u2 = E[at, 5] + (E[at, 12] * a + E[at, 13] * b + E[at, 14] * c)
    m = 0
    for d in range(ray, end):
        length = reach[row, d]
        cut = 1 if length < horizon else 0
        inverse = 0.0 if length == 0.0 else 1.0 / length
        e0, e1, e2 = way[d, 0], way[d, 1], way[d, 2]
        for p in range(nrad):
            at = np.uint32(element[row, d, p])
            r = length * node[0, cut, p]
            a = x0 + r * e0 - E[at, 0]
            W[m + XI] = a
            if dim == 1:
                t = e0 * (E[at, 1] + E[at, 2] * a - u0)
            elif dim == 2:
                b = x1 + r * e1 - E[at, 1]
                W[m + YI] = b
                t = e0 * (E[at, 2] + (E[at, 4] * a + E[at, 5] * b) - u0)
                t += e1 * (E[at, 3] + (E[at, 6] * a + E[at, 7] * b) - u1)
            else:
                b = x1 + r * e1 - E[at, 1]
                c = x2 + r * e2 - E[at, 2]
                W[m + YI] = b
                W[m + ZI] = c
                t = e0 * (E[at, 3] + (E[at, 6] * a + E[at, 7] * b + E[at, 8] * c) - u0)
                t += e1 * (E[at, 4] + (E[at, 9] * a + E[at, 10] * b + E[at, 11] * c) - u1)
                t += e2 * (E[at, 5] + (E[at, 12] * a + E[at, 13] * b + E[at, 14] * c) - u2)
            W[m + S] = t
            W[m + R2] = inverse * node[1, cut, p]
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
def _scatter(
    axes: Any, row: int, x: Any, own: Any, element: Any, way: Any, ray: int, end: int, both: bool, W: Any, M: Any
) -> None:
    """Add ``k e`` at the site; take it and its moment off the far element, where it acts on both."""
    dim, nrad = len(axes), element.shape[2]
    fx, fy, fz = 0.0, 0.0, 0.0
    m = 0
    for d in range(ray, end):
        e0, e1, e2 = way[d, 0], way[d, 1], way[d, 2]
        whole = 0.0
        for p in range(nrad):
            g = W[m + K]
            whole += g
            if both:
                at = np.uint32(element[row, d, p])
                a, X = g * e0, W[m + XI]
                M[at, 0] -= a
                if dim == 1:
                    M[at, 1] -= a * X
                elif dim == 2:
                    b, Y = g * e1, W[m + YI]
                    M[at, 1] -= b
                    M[at, 2] -= a * X
                    M[at, 3] -= a * Y
                    M[at, 4] -= b * X
                    M[at, 5] -= b * Y
                else:
                    b, c, Y, Z = g * e1, g * e2, W[m + YI], W[m + ZI]
                    M[at, 1] -= b
                    M[at, 2] -= c
                    M[at, 3] -= a * X
                    M[at, 4] -= a * Y
                    M[at, 5] -= a * Z
                    M[at, 6] -= b * X
                    M[at, 7] -= b * Y
                    M[at, 8] -= b * Z
                    M[at, 9] -= c * X
                    M[at, 10] -= c * Y
                    M[at, 11] -= c * Z
            m += 1
        fx += whole * e0
        fy += whole * e1
        fz += whole * e2
    if not both:
        fx, fy, fz = 2.0 * fx, 2.0 * fy, 2.0 * fz
    _add(axes, x, own, row, fx, fy, fz, M)


@compiled
def _add(axes: Any, x: Any, own: Any, row: int, fx: float, fy: float, fz: float, M: Any) -> None:
    """Add a force at a site to the element that holds it; columns 0..2 of x are the site, 3..5 that corner."""
    dim = len(axes)
    at = own[row]
    M[at, 0] += fx
    for b in range(dim):
        away = x[row, b] - x[row, 3 + b]
        M[at, dim + b] += fx * away
        if dim > 1:
            M[at, 2 * dim + b] += fy * away
        if dim > 2:
            M[at, 3 * dim + b] += fz * away
    if dim > 1:
        M[at, 1] += fy
    if dim > 2:
        M[at, 2] += fz


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
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            n = (end - ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ray, end, W)
            _pull(n, given, (row * ndir + ray) * nrad, scale, W)
            bend(kind, slope, b, law, W, n)
            _scatter(axes, row, x, own, element, way, ray, end, both, W, M)


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
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ray, end, W)
            _pull(n, given, (row * ndir + ray) * nrad, scale, W)
            total += stored(kind, slope, b, law, W, n)
    return total


@compiled
def strains(
    axes: Any, x: Any, own: Any, reach: Any, element: Any, horizon: float, way: Any, node: Any, E: Any, T: Any
) -> None:
    """Write the scaled strains ``T = t / sqrt(r)`` of the bonds."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            at = (row * ndir + ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ray, end, W)
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
    weight: Any,
    both: bool,
    M: Any,
) -> None:
    """Take ``X^T diag(weight) B u`` off the element sums M, B the map from displacements to scaled strains."""
    W = np.empty(ROOM)
    ndir, nrad = element.shape[1], element.shape[2]
    rays = max(1, BATCH // nrad)
    for row in range(len(own)):
        for ray in range(0, ndir, rays):
            end = min(ndir, ray + rays)
            n = (end - ray) * nrad
            _gather(axes, row, x, own, reach, element, horizon, way, node, E, ray, end, W)
            _pull(n, weight, (row * ndir + ray) * nrad, 1.0, W)
            for m in range(n):
                W[m + K] *= W[m + C]
            _scatter(axes, row, x, own, element, way, ray, end, both, W, M)


@compiled
def tabulate(axes: Any, corners: Any, gradient: Any, u: Any, low: int, high: int, E: Any) -> None:
    """Fill in u0 and G of some elements from nodal values; ``gradient`` is that of the barycentric coordinates."""
    dim = len(axes)
    for e in range(low, high):
        base = corners[0, e]
        for a in range(dim):
            u0 = u[base, a]
            E[e, dim + a] = u0
            for b in range(dim):
                slope = 0.0
                for k in range(1, dim + 1):
                    slope += (u[corners[k, e], a] - u0) * gradient[e, k, b]
                E[e, 2 * dim + a * dim + b] = slope


@compiled
def hand_over(axes: Any, corners: Any, gradient: Any, M: Any, low: int, high: int, F: Any) -> None:
    """Add what some elements have summed to nodal forces, by P1 values at their corners; empty the sums."""
    dim = len(axes)
    for e in range(low, high):
        for a in range(dim):
            rest = M[e, a]
            M[e, a] = 0.0
            for k in range(1, dim + 1):
                part = 0.0
                for b in range(dim):
                    part += M[e, dim + a * dim + b] * gradient[e, k, b]
                F[corners[k, e], a] += part
                rest -= part
            for b in range(dim):
                M[e, dim + a * dim + b] = 0.0
            F[corners[0, e], a] += rest
