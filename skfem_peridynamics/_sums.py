"""Sums that come out the same for any number of threads: BLAS splits its own by how many it has."""

from __future__ import annotations

import numpy as np

from ._types import Floats


def inner(a: Floats, b: Floats) -> float:
    """Return ``a.b``, summed pairwise.

    >>> inner(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    11.0
    """
    return float(np.add.reduce(a * b))
