"""Symmetric tensors as coefficients of monomials: moments of bond directions, and Killing tensors of valence three."""

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


def killing_tensors(x: Floats) -> Floats:
    """Return the Killing tensors of valence three at points (n, dim), coefficients of the monomials, (n, n3, count).

    They are products of three of ``e_i`` and ``x_i e_j - x_j e_i``: 1, 10 and 50 of them in 1D, 2D and 3D (56 products
    in 3D, six of which depend on the others).
    """
    n, dim = x.shape
    x = (x - x.mean(axis=0)) / max(float(np.ptp(x, axis=0).max()), np.finfo(float).tiny)
    forms = [np.tile(unit, (n, 1)) for unit in np.eye(dim)]
    for i in range(dim):
        for j in range(i + 1, dim):
            turn = np.zeros((n, dim))
            # the rotation in the plane of the axes i and j
            turn[:, j], turn[:, i] = x[:, i], -x[:, j]
            forms.append(turn)
    index = monomials(dim, 3)
    place = {key: k for k, key in enumerate(index)}
    out = []
    for a, b, c in combinations_with_replacement(range(len(forms)), 3):
        tensor = np.zeros((n, len(index)))
        for i in range(dim):
            for j in range(dim):
                for k in range(dim):
                    tensor[:, place[tuple(sorted((i, j, k)))]] += forms[a][:, i] * forms[b][:, j] * forms[c][:, k]
        out.append(tensor)
    return np.stack(out, axis=2)
