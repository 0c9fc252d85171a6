"""Compiled loops over the bonds of one batch: laws, and the two elementary functions they need.

A batch holds ``q = T^2`` of some bonds. The named laws are told apart once a batch, by their number; the loop of each
vectorises. A law of the user's comes as the compiled scalar function that is needed, and its number is :data:`OWN`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .._compile import compiled, unordered

EXPONENTIAL, RATIONAL, LINEAR, OWN = range(4)
TENSION = 8  # is added to the number of a law that softens in tension only
BATCH = 512  # bonds

# A batch lives in one array, a row after the other: with distances that the compiler knows it need not ask at run time
# whether rows overlap, and vectorises. Rows: bond vectors, s = xi.(u_y - u_x), r^2, a spare one, measures k,
# c = s / r^3, q = s c.
_ROW = BATCH + 24  # not a power of two: rows a page apart would share their places in the cache
XI, YI, ZI, S, R2, REST, K, C, Q = (row * _ROW for row in range(9))
ROOM = 9 * _ROW

# exp(r) on |r| <= 0.3466: interpolation in the 12 Chebyshev nodes, off by 3e-18
C0, C1, C2, C3 = 1.0, 1.0, 0.5000000000000019, 0.1666666666666668
C4, C5, C6, C7 = 0.04166666666648799, 0.008333333333319592, 0.0013888888952343797, 0.00019841269890069431
C8, C9, C10, C11 = 2.4801485451264055e-05, 2.7557240894691074e-06, 2.76326511328741e-07, 2.5110046444457486e-08


@intrinsic  # type: ignore[untyped-decorator]
def _bits(context: Any, x: Any) -> Any:
    """The bits of a double as an integer."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), build


@intrinsic  # type: ignore[untyped-decorator]
def _double(context: Any, x: Any) -> Any:
    """The double of these bits."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), build


@compiled
def inverse_root(x: float) -> float:
    """``1 / sqrt(x)`` of a positive x, to two units in the last place, without a division.

    The first guess halves the exponent; each step of Newton's doubles the digits.
    """
    y = _double(0x5FE6EB50C7B537A9 - (_bits(x) >> 1))
    half = 0.5 * x
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    return y + y * (0.5 - half * y * y)  # type: ignore[no-any-return]


@compiled
def exponential(x: float) -> float:
    """``exp(x)`` for x <= 0, to two units in the last place; below -708, where it is 3e-308, that.

    ``x = n log 2 + r``: the power of two goes into the exponent, a polynomial of degree 11 does ``|r| <= log(2) / 2``.
    """
    x = max(x, -708.0)
    n = x * 1.4426950408889634 + 6755399441055744.0  # adding 1.5 * 2^52 rounds to an integer
    power = _bits(n)
    n = n - 6755399441055744.0
    r = x - n * 6.93147180369123816490e-01  # log 2 in two parts
    r = r - n * 1.90821492927058770002e-10
    r2 = r * r
    low = (C0 + r * C1) + r2 * (C2 + r * C3)
    middle = (C4 + r * C5) + r2 * (C6 + r * C7)
    high = (C8 + r * C9) + r2 * (C10 + r * C11)
    r4 = r2 * r2
    return (low + r4 * (middle + r4 * high)) * _double((power + 1023) << 52)  # type: ignore[no-any-return]


@compiled
def _only_stretched(W: Any, n: int) -> None:
    """Put bonds that are pressed where every law is linear."""
    for m in range(n):
        W[m + Q] = W[m + Q] if W[m + C] > 0.0 else 0.0


@compiled
def snap(limit: float, both: bool, W: Any, given: Any, low: int, n: int) -> int:
    """Break the bonds with Q above a limit, in tension or in ``both`` directions, and count them.

    K becomes 0, and the measure given for them -1, by which they are found.
    """
    count = 0
    least = -np.inf if both else 0.0
    for m in range(n):
        # counted first, without a branch that would keep the loop from vectorising: in most batches nothing breaks
        count += 1 if (W[m + K] > 0.0) & (W[m + Q] > limit) & (W[m + C] > least) else 0
    if count:
        for m in range(n):
            if (W[m + K] > 0.0) & (W[m + Q] > limit) & (W[m + C] > least):
                W[m + K] = 0.0
                given[low + m] = -1.0
    return count


@compiled
def bend(kind: int, slope: float, b: float, own: Any, W: Any, n: int) -> None:
    """Turn K into ``2 K C f'(Q)``."""
    twice = 2.0 * slope
    if kind >= TENSION:
        _only_stretched(W, n)
        kind -= TENSION
    if own is not None:
        for m in range(n):
            W[m + K] *= 2.0 * W[m + C] * own(W[m + Q])
    elif kind == EXPONENTIAL:
        for m in range(n):
            # C f'(Q) = slope C exp(-b Q)
            W[m + K] *= twice * W[m + C] * exponential(-b * W[m + Q])
    elif kind == RATIONAL:
        for m in range(n):
            t = 1.0 / (1.0 + b * W[m + Q])
            W[m + K] *= twice * W[m + C] * t * t
    else:
        for m in range(n):
            W[m + K] *= twice * W[m + C]


@compiled
def stored(kind: int, slope: float, b: float, own: Any, W: Any, n: int) -> float:
    """Return ``sum K f(Q)``."""
    total, pressed = 0.0, 0.0
    if kind >= TENSION:
        for m in range(n):
            # what is pressed stores f'(0) q, linear for ever; the law sees q = 0 there
            pressed += W[m + K] * (W[m + Q] if W[m + C] < 0.0 else 0.0)
        _only_stretched(W, n)
        kind -= TENSION
    if own is not None:
        for m in range(n):
            total += W[m + K] * own(W[m + Q])
    elif kind == EXPONENTIAL:
        for m in range(n):
            total -= W[m + K] * np.expm1(-b * W[m + Q])
        total *= slope / b
    elif kind == RATIONAL:
        far = 1e300 / max(b, 1.0)  # no infinity over infinity
        for m in range(n):
            q = min(W[m + Q], far)
            total += W[m + K] * (q / (1.0 + b * q))
        total *= slope
    else:
        for m in range(n):
            total += W[m + K] * W[m + Q]
        total *= slope
    return total + slope * pressed


@unordered
def multiplied(W: Any, row: int, n: int) -> float:
    """Multiply a row by K; return the sum of the products."""
    total = 0.0
    for m in range(n):
        product = W[m + K] * W[m + row]
        W[m + row] = product
        total += product
    return total
