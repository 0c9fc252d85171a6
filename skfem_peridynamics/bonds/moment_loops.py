"""Compiled sums of products with monomials of directions, over vertex pairs: what balancing is made of.

For a bond from x to y with unit vector e the monomials of order three count with opposite signs at its two ends, and
those of order four, times r / horizon, with the same. Multipliers and moments are (nsamples, columns): order three,
then, in two dimensions and with ``four``, order four.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import unordered


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
            s[p] = total


@unordered
def spread_3(start: Any, far: Any, x: Any, row: int, scale: float, w: Any, four: bool, out: Any) -> None:
    """The same in three dimensions."""
    for i in range(row, row + len(start) - 1):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        z0 = z1 = z2 = z3 = z4 = z5 = z6 = z7 = z8 = z9 = 0.0
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
