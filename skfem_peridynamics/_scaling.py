"""Powers and roots that a change of units by powers of two leaves alone, to the last bit, on any processor.

A library's ``pow`` and ``cbrt`` are right to a unit in the last place at best, and to another one on another processor.
"""

from __future__ import annotations

from typing import overload

import numpy as np

from ._types import Floats


@overload
def whole_power(x: float, n: int) -> float: ...
@overload
def whole_power(x: Floats, n: int) -> Floats: ...
def whole_power(x: float | Floats, n: int) -> float | Floats:
    """Return ``x^n`` for a whole n that is not negative, by n - 1 products.

    >>> whole_power(0.1, 3) == 0.1 * 0.1 * 0.1, whole_power(np.array([2.0, 3.0]), 0).tolist()
    (True, [1.0, 1.0])
    """
    if n == 0:
        return np.ones_like(x) if isinstance(x, np.ndarray) else 1.0
    power = x
    for _ in range(n - 1):
        power = power * x
    return power


def cube_root(x: Floats) -> Floats:
    """Return the cube roots of positive numbers; scaled by 8^k they are scaled by 2^k exactly.

    >>> cube_root(np.array([8.0, 27.0])).round(12).tolist()
    [2.0, 3.0]
    """
    mantissa, exponent = np.frexp(x)
    thirds = exponent // 3
    rest = np.ldexp(mantissa, exponent - 3 * thirds)  # in [1/2, 4): the same number whatever the power of 8
    root = np.cbrt(rest)
    root -= (root * root * root - rest) / (3.0 * root * root)  # a step of Newton's: to about one unit on any processor
    scaled: Floats = np.ldexp(root, thirds)
    return scaled
