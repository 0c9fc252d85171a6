"""Symmetric tensors as coefficients of monomials: moments of bond directions."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from .._types import Floats


def monomials(dim: int, order: int) -> list[tuple[int, ...]]:
    """Return the index tuples of the monomials of an order, ``e[i] e[j] ..``.

    >>> monomials(2, 3)
    [(0, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 1)]
    """
    return list(combinations_with_replacement(range(dim), order))


def powers(e: Floats, order: int) -> Floats:
    """Return all monomials of an order of vectors (n, dim), (n, nmonomials)."""
    known: dict[tuple[int, ...], Floats] = {(): np.ones(len(e))}
    for degree in range(1, order + 1):
        known = {index: known[index[:-1]] * e[:, index[-1]] for index in monomials(e.shape[1], degree)}
    return np.stack(list(known.values()), axis=1)
