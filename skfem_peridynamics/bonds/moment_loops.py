"""Compiled sums of products with monomials of directions, over vertex pairs and over facets: what balancing is made of.

For a bond from x to y with unit vector e the monomials of order three count with opposite signs at its two ends, and
those of order four, times r / horizon, with the same. Multipliers and moments are (nsamples, columns): order three,
then four.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import unordered
from .quadrature import FINE, FINER

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@unordered
def gather_2(start: Any, far: Any, x: Any, row: int, scale: float, y: Any, four: bool, s: Any) -> None:
    """What each bond gathers of the multipliers ``y``, in two dimensions; ``scale`` is 1 / horizon."""
    for i in range(row, row + len(start) - 1):
        x0, x1 = x[i, 0], x[i, 1]
        y0, y1, y2, y3 = y[i, 0], y[i, 1], y[i, 2], y[i, 3]
        if four:
            y4, y5, y6, y7, y8 = y[i, 4], y[i, 5], y[i, 6], y[i, 7], y[i, 8]
            for p in range(start[i - row], start[i - row + 1]):
                j = far[p]
                a, b = x[j, 0] - x0, x[j, 1] - x1
                r = np.sqrt(a * a + b * b)
                q = 1.0 / r
                a, b = a * q, b * q
                cubic = a * (a * (a * (y0 - y[j, 0]) + b * (y1 - y[j, 1])) + b * b * (y2 - y[j, 2]))
                quartic = a * (a * (a * (a * (y4 + y[j, 4]) + b * (y5 + y[j, 5])) + b * b * (y6 + y[j, 6])))
                quartic += b * b * b * (a * (y7 + y[j, 7]) + b * (y8 + y[j, 8]))
                s[p] = cubic + b * b * b * (y3 - y[j, 3]) + r * scale * quartic
        else:
            for p in range(start[i - row], start[i - row + 1]):
                j = far[p]
                a, b = x[j, 0] - x0, x[j, 1] - x1
                q = 1.0 / np.sqrt(a * a + b * b)
                a, b = a * q, b * q
                cubic = a * (a * (a * (y0 - y[j, 0]) + b * (y1 - y[j, 1])) + b * b * (y2 - y[j, 2]))
                s[p] = cubic + b * b * b * (y3 - y[j, 3])


@unordered
def spread_2(start: Any, far: Any, x: Any, row: int, scale: float, w: Any, four: bool, out: Any) -> None:
    """Add the moments of weights ``w``, in two dimensions."""
    for i in range(row, row + len(start) - 1):
        x0, x1 = x[i, 0], x[i, 1]
        z0 = z1 = z2 = z3 = z4 = z5 = z6 = z7 = z8 = 0.0
        for p in range(start[i - row], start[i - row + 1]):
            j = far[p]
            a, b = x[j, 0] - x0, x[j, 1] - x1
            r = np.sqrt(a * a + b * b)
            q = 1.0 / r
            a, b = a * q, b * q
            t = w[p]
            aa, ab, bb = a * a * t, a * b * t, b * b * t
            m0, m1, m2, m3 = a * aa, b * aa, b * ab, b * bb
            z0, z1, z2, z3 = z0 + m0, z1 + m1, z2 + m2, z3 + m3
            out[j, 0] -= m0
            out[j, 1] -= m1
            out[j, 2] -= m2
            out[j, 3] -= m3
            if four:
                c, d = a * r * scale, b * r * scale
                m4, m5, m6, m7, m8 = c * m0, d * m0, d * m1, d * m2, d * m3
                z4, z5, z6, z7, z8 = z4 + m4, z5 + m5, z6 + m6, z7 + m7, z8 + m8
                out[j, 4] += m4
                out[j, 5] += m5
                out[j, 6] += m6
                out[j, 7] += m7
                out[j, 8] += m8
        out[i, 0] += z0
        out[i, 1] += z1
        out[i, 2] += z2
        out[i, 3] += z3
        if four:
            out[i, 4] += z4
            out[i, 5] += z5
            out[i, 6] += z6
            out[i, 7] += z7
            out[i, 8] += z8


@unordered
def gather_3(start: Any, far: Any, x: Any, row: int, scale: float, y: Any, four: bool, s: Any) -> None:
    """The same in three dimensions."""
    for i in range(row, row + len(start) - 1):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        for p in range(start[i - row], start[i - row + 1]):
            j = far[p]
            a, b, c = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
            r = np.sqrt(a * a + b * b + c * c)
            q = 1.0 / r
            a, b, c = a * q, b * q, c * q
            aa, ab, ac, bb, bc, cc = a * a, a * b, a * c, b * b, b * c, c * c
            total = a * (aa * (y[i, 0] - y[j, 0]) + ab * (y[i, 1] - y[j, 1]) + ac * (y[i, 2] - y[j, 2]))
            total += a * (bb * (y[i, 3] - y[j, 3]) + bc * (y[i, 4] - y[j, 4]) + cc * (y[i, 5] - y[j, 5]))
            total += b * (bb * (y[i, 6] - y[j, 6]) + bc * (y[i, 7] - y[j, 7]) + cc * (y[i, 8] - y[j, 8]))
            total += c * cc * (y[i, 9] - y[j, 9])
            if four:
                quartic = aa * (aa * (y[i, 10] + y[j, 10]) + ab * (y[i, 11] + y[j, 11]) + ac * (y[i, 12] + y[j, 12]))
                quartic += aa * (bb * (y[i, 13] + y[j, 13]) + bc * (y[i, 14] + y[j, 14]) + cc * (y[i, 15] + y[j, 15]))
                quartic += ab * (bb * (y[i, 16] + y[j, 16]) + bc * (y[i, 17] + y[j, 17]) + cc * (y[i, 18] + y[j, 18]))
                quartic += ac * cc * (y[i, 19] + y[j, 19])
                quartic += bb * (bb * (y[i, 20] + y[j, 20]) + bc * (y[i, 21] + y[j, 21]) + cc * (y[i, 22] + y[j, 22]))
                quartic += bc * cc * (y[i, 23] + y[j, 23]) + cc * cc * (y[i, 24] + y[j, 24])
                total += r * scale * quartic
            s[p] = total


@unordered
def _add_four(
    z: Any, ua: float, ub: float, uc: float, aa: float, ab: float, ac: float, bb: float, bc: float, cc: float
) -> None:
    """Add the fifteen products of order four; ``ua`` is a weight times ``aa``, and so on."""
    z[10] += ua * aa
    z[11] += ua * ab
    z[12] += ua * ac
    z[13] += ua * bb
    z[14] += ua * bc
    z[15] += ua * cc
    z[16] += ub * ab
    z[17] += ub * ac
    z[18] += uc * ab
    z[19] += uc * ac
    z[20] += ub * bb
    z[21] += ub * bc
    z[22] += ub * cc
    z[23] += uc * bc
    z[24] += uc * cc


@unordered
def spread_3(start: Any, far: Any, x: Any, row: int, scale: float, w: Any, four: bool, out: Any) -> None:
    """The same in three dimensions."""
    z = np.zeros(25)
    for i in range(row, row + len(start) - 1):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        z0 = z1 = z2 = z3 = z4 = z5 = z6 = z7 = z8 = z9 = 0.0
        z[:] = 0.0
        for p in range(start[i - row], start[i - row + 1]):
            j = far[p]
            a, b, c = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
            r = np.sqrt(a * a + b * b + c * c)
            q = 1.0 / r
            a, b, c = a * q, b * q, c * q
            t = w[p]
            aa, ab, ac, bb, bc, cc = a * a, a * b, a * c, b * b, b * c, c * c
            ta, tb = t * a, t * b
            m0, m1, m2, m3, m4, m5 = ta * aa, ta * ab, ta * ac, ta * bb, ta * bc, ta * cc
            m6, m7, m8, m9 = tb * bb, tb * bc, tb * cc, t * c * cc
            z0, z1, z2, z3, z4 = z0 + m0, z1 + m1, z2 + m2, z3 + m3, z4 + m4
            z5, z6, z7, z8, z9 = z5 + m5, z6 + m6, z7 + m7, z8 + m8, z9 + m9
            out[j, 0] -= m0
            out[j, 1] -= m1
            out[j, 2] -= m2
            out[j, 3] -= m3
            out[j, 4] -= m4
            out[j, 5] -= m5
            out[j, 6] -= m6
            out[j, 7] -= m7
            out[j, 8] -= m8
            out[j, 9] -= m9
            if four:
                u = r * scale * t
                ua, ub, uc = u * aa, u * bb, u * cc
                _add_four(z, ua, ub, uc, aa, ab, ac, bb, bc, cc)
                _add_four(out[j], ua, ub, uc, aa, ab, ac, bb, bc, cc)
        out[i, 0] += z0
        out[i, 1] += z1
        out[i, 2] += z2
        out[i, 3] += z3
        out[i, 4] += z4
        out[i, 5] += z5
        out[i, 6] += z6
        out[i, 7] += z7
        out[i, 8] += z8
        out[i, 9] += z9
        if four:
            for k in range(10, 25):
                out[i, k] += z[k]


GATHER = {2: gather_2, 3: gather_3}
SPREAD = {2: spread_2, 3: spread_3}


@unordered
def degree(start: Any, far: Any, row: int, w: Any, out: Any) -> None:
    """Add the weights of the bonds at each sample."""
    for i in range(row, row + len(start) - 1):
        own = 0.0
        for p in range(start[i - row], start[i - row + 1]):
            own += w[p]
            out[far[p]] += w[p]
        out[i] += own


@unordered
def own_weights(start: Any, far: Any, x: Any, row: int, reach: float, size: Any, volume: Any, out: Any) -> None:
    """The rule's own weights, as ``PairBonds.own_weight`` makes them: 2 for both orders, the rim shared out."""
    dim = x.shape[1]
    for i in range(row, row + len(start) - 1):
        for p in range(start[i - row], start[i - row + 1]):
            j = far[p]
            share = 2.0
            if reach > 0.0:
                square = 0.0
                for k in range(dim):
                    square += (x[j, k] - x[i, k]) ** 2
                short = reach - np.sqrt(square)
                share = min(max(short / size[i] + 0.5, 0.0), 1.0) + min(max(short / size[j] + 0.5, 0.0), 1.0)
            out[p] = volume[i] * volume[j] * share


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
                    if four:
                        w = omega * (table[1, low] + part * (table[1, low + 1] - table[1, low]) - whole[1])
                        _add_four(out[i], w * e00, w * e11, w * e22, e00, e01, e02, e11, e12, e22)
