"""Compiled loops over boundary facets and the vertices that face them: which they are, what they add to moments."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled, unordered
from .quadrature import FINE, FINER

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@compiled
def facing(
    x: Any, cell: Any, shape: Any, order: Any, start: Any, circles: Any, eps: float, flat: float, found: Any, count: Any
) -> int:
    """Facets that vertices face within ``eps``, by cells of the middles of facets; how many, or would be with room.

    ``x`` and ``circles`` (n, 3), (n, 7): of a facet the middle, the normal out of the body, the radius of a circle
    around it. ``cell`` (n, 3) is that of each vertex. A vertex closer than ``flat`` to the plane faces no side of it.
    """
    total = 0
    for i in range(len(x)):
        begin = total
        for a in range(max(cell[i, 0] - 1, 0), min(cell[i, 0] + 2, shape[0])):
            for b in range(max(cell[i, 1] - 1, 0), min(cell[i, 1] + 2, shape[1])):
                row, first, last = (a * shape[1] + b) * shape[2], cell[i, 2] - 1, cell[i, 2] + 2
                if last <= 0 or first >= shape[2]:
                    continue
                for k in range(start[row + max(first, 0)], start[row + min(last, shape[2])]):
                    f = order[k]
                    d0, d1, d2 = circles[f, 0] - x[i, 0], circles[f, 1] - x[i, 1], circles[f, 2] - x[i, 2]
                    height = d0 * circles[f, 3] + d1 * circles[f, 4] + d2 * circles[f, 5]
                    if height <= flat or height >= eps:
                        continue
                    # no closer than this: the height over the plane, and the way in it to the circle
                    aside = np.sqrt(max(d0 * d0 + d1 * d1 + d2 * d2 - height * height, 0.0)) - circles[f, 6]
                    if aside <= 0.0 or height * height + aside * aside < eps * eps:
                        if total < len(found):
                            found[total] = f
                        total += 1
        count[i] = total - begin
        if total <= len(found):
            found[begin:total].sort()
    return total


@unordered
def add_edges(
    x: Any, corners: Any, vertex: Any, facet: Any, least: int, eps: float, table: Any, whole: Any, four: bool, out: Any
) -> None:
    """Add ``e^alpha`` times angle times ``table(rho / eps) - whole`` over edges seen from vertices, by Gauss points.

    ``table`` (2, m) are the radial integrals for order three and four, at equal distances from 0 to eps; columns of
    ``out`` are the monomials of order three, then four. ``least`` is that of triangles, and not used.
    """
    last = table.shape[1] - 1
    for k in range(len(vertex)):
        i, f = vertex[k], facet[k]
        ax, ay = corners[f, 0, 0] - x[i, 0], corners[f, 0, 1] - x[i, 1]
        bx, by = corners[f, 1, 0] - x[i, 0], corners[f, 1, 1] - x[i, 1]
        first, turn = np.arctan2(ay, ax), np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        nx, ny = by - ay, ax - bx
        height = abs(ax * nx + ay * ny)
        for g in range(4):
            angle = first + 0.5 * turn * (1.0 + _NODES[g])
            c, s = np.cos(angle), np.sin(angle)
            across = abs(c * nx + s * ny)
            if height >= across * eps:
                continue
            place = height / (across * eps) * last
            low = int(place)
            part, omega = place - low, 0.5 * abs(turn) * _WEIGHTS[g]
            w = omega * (table[0, low] + part * (table[0, low + 1] - table[0, low]) - whole[0])
            cc, cs, ss = c * c, c * s, s * s
            out[i, 0] += w * c * cc
            out[i, 1] += w * s * cc
            out[i, 2] += w * c * ss
            out[i, 3] += w * s * ss
            if four:
                w = omega * (table[1, low] + part * (table[1, low + 1] - table[1, low]) - whole[1])
                out[i, 4] += w * cc * cc
                out[i, 5] += w * cc * cs
                out[i, 6] += w * cc * ss
                out[i, 7] += w * cs * ss
                out[i, 8] += w * ss * ss


@unordered
def add_triangles(
    x: Any, corners: Any, vertex: Any, facet: Any, least: int, eps: float, table: Any, whole: Any, four: bool, out: Any
) -> None:
    """Add ``e^alpha`` times solid angle times ``table(rho / eps) - whole`` over triangles ``facet`` seen from vertices.

    The closer a triangle the more parts it is seen in, ``least^2`` at the least. ``table`` (2, m) are the radial
    integrals for order three and four, at equal distances from 0 to eps; columns of ``out`` are the monomials of order
    three, then four.
    """
    last = table.shape[1] - 1
    p = np.zeros((3, 3))
    for k in range(len(vertex)):
        i, f = vertex[k], facet[k]
        a0, a1, a2 = corners[f, 0, 0] - x[i, 0], corners[f, 0, 1] - x[i, 1], corners[f, 0, 2] - x[i, 2]
        b0, c0 = corners[f, 1, 0] - corners[f, 0, 0], corners[f, 2, 0] - corners[f, 0, 0]
        b1, c1 = corners[f, 1, 1] - corners[f, 0, 1], corners[f, 2, 1] - corners[f, 0, 1]
        b2, c2 = corners[f, 1, 2] - corners[f, 0, 2], corners[f, 2, 2] - corners[f, 0, 2]
        n0, n1, n2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
        height = abs(a0 * n0 + a1 * n1 + a2 * n2)
        edge = max(b0 * b0 + b1 * b1 + b2 * b2, c0 * c0 + c1 * c1 + c2 * c2)
        edge = max(edge, (b0 - c0) ** 2 + (b1 - c1) ** 2 + (b2 - c2) ** 2)
        m0, m1, m2 = a0 + (b0 + c0) / 3.0, a1 + (b1 + c1) / 3.0, a2 + (b2 + c2) / 3.0
        ratio = edge / max(m0 * m0 + m1 * m1 + m2 * m2, 1e-300)
        n = max(least, 1 if ratio <= FINE else (2 if ratio <= FINER else 4))
        step = 1.0 / n
        for u in range(n):
            for v in range(n - u):
                for up in range(2):
                    if up == 1 and v == n - u - 1:
                        continue
                    for q in range(3):
                        # the corners of a part that points the way of the whole, or of one turned about
                        su, sv = (u + (q == 1)) * step, (v + (q == 2)) * step
                        if up == 1:
                            su, sv = (u + (q != 2)) * step, (v + (q != 0)) * step
                        p[q, 0] = a0 + su * b0 + sv * c0
                        p[q, 1] = a1 + su * b1 + sv * c1
                        p[q, 2] = a2 + su * b2 + sv * c2
                    la = np.sqrt(p[0, 0] ** 2 + p[0, 1] ** 2 + p[0, 2] ** 2)
                    lb = np.sqrt(p[1, 0] ** 2 + p[1, 1] ** 2 + p[1, 2] ** 2)
                    lc = np.sqrt(p[2, 0] ** 2 + p[2, 1] ** 2 + p[2, 2] ** 2)
                    ab = p[0, 0] * p[1, 0] + p[0, 1] * p[1, 1] + p[0, 2] * p[1, 2]
                    ac = p[0, 0] * p[2, 0] + p[0, 1] * p[2, 1] + p[0, 2] * p[2, 2]
                    bc = p[1, 0] * p[2, 0] + p[1, 1] * p[2, 1] + p[1, 2] * p[2, 2]
                    omega = 2.0 * np.arctan2(height * step * step, la * lb * lc + ab * lc + ac * lb + bc * la)
                    e0 = p[0, 0] / la + p[1, 0] / lb + p[2, 0] / lc
                    e1 = p[0, 1] / la + p[1, 1] / lb + p[2, 1] / lc
                    e2 = p[0, 2] / la + p[1, 2] / lb + p[2, 2] / lc
                    size = 1.0 / np.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
                    e0, e1, e2 = e0 * size, e1 * size, e2 * size
                    across = abs(e0 * n0 + e1 * n1 + e2 * n2)
                    if height >= across * eps:  # beyond the horizon, or seen from its edge
                        continue
                    place = height / (across * eps) * last
                    low = int(place)
                    part = place - low
                    w = omega * (table[0, low] + part * (table[0, low + 1] - table[0, low]) - whole[0])
                    e00, e01, e02, e11, e12, e22 = e0 * e0, e0 * e1, e0 * e2, e1 * e1, e1 * e2, e2 * e2
                    out[i, 0] += w * e0 * e00
                    out[i, 1] += w * e0 * e01
                    out[i, 2] += w * e0 * e02
                    out[i, 3] += w * e0 * e11
                    out[i, 4] += w * e0 * e12
                    out[i, 5] += w * e0 * e22
                    out[i, 6] += w * e1 * e11
                    out[i, 7] += w * e1 * e12
                    out[i, 8] += w * e1 * e22
                    out[i, 9] += w * e2 * e22
